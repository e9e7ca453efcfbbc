# SPDX-License-Identifier: GPL-3.0-or-later
"""Run inside Blender: renders the current frame and writes it as a multilayer OpenEXR file with all passes and a PNG."""

import os

import bpy


def choose_format(scene: bpy.types.Scene, media_type: str, file_format: str) -> None:
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # Blender 5
        settings.media_type = media_type
    settings.file_format = file_format


def main() -> None:
    scene = bpy.context.scene
    scene.render.use_file_extension = True
    choose_format(scene, "MULTI_LAYER_IMAGE", "OPEN_EXR_MULTILAYER")
    scene.render.image_settings.color_depth = "32"
    exr_path = bpy.path.abspath(scene.render.frame_path(frame=scene.frame_current))
    # A still is written to the path as it is, without a frame number for "####".
    scene.render.filepath = exr_path.removesuffix(".exr")
    bpy.ops.render.render(write_still=True)
    choose_format(scene, "IMAGE", "PNG")
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.image_settings.color_depth = "8"
    png_path = scene.render.filepath + ".png"
    bpy.data.images["Render Result"].save_render(png_path, scene=scene)
    with open(os.environ["FUMAROLE_PICTURES"], "w", encoding="utf-8") as pictures:
        pictures.write(f"{png_path}\n{exr_path}\n")


main()
