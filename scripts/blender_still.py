# SPDX-License-Identifier: GPL-3.0-or-later
"""Run inside Blender: renders the current frame and writes it as a multilayer OpenEXR file with all passes and a PNG."""

import os

import bpy


def main() -> None:
    scene = bpy.context.scene
    image_settings = scene.render.image_settings
    if hasattr(image_settings, "media_type"):
        image_settings.media_type = "MULTI_LAYER_IMAGE"
    image_settings.file_format = "OPEN_EXR_MULTILAYER"
    image_settings.color_depth = "32"
    scene.render.use_file_extension = True
    bpy.ops.render.render(write_still=True)
    exr_path = scene.render.frame_path(frame=scene.frame_current)
    if hasattr(image_settings, "media_type"):
        image_settings.media_type = "IMAGE"
    image_settings.file_format = "PNG"
    image_settings.color_mode = "RGBA"
    png_path = bpy.path.abspath(scene.render.frame_path(frame=scene.frame_current))
    bpy.data.images["Render Result"].save_render(png_path, scene=scene)
    with open(os.environ["FUMAROLE_PICTURES"], "w", encoding="utf-8") as pictures:
        pictures.write(f"{png_path}\n{bpy.path.abspath(exr_path)}\n")


main()
