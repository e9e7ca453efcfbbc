# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as linear arrays."""

from __future__ import annotations

import bpy
import numpy as np

from .nodes import Warn

# Colour spaces of 8-bit images whose pixels are linear already.
_LINEAR = ("Linear", "Linear Rec.709", "Non-Color", "Raw")


def read_picture(image: bpy.types.Image | None, owner: str, warn: Warn) -> np.ndarray | None:
    """The pixels (height, width, 3) of an image as linear float32, at least 0, first row at the bottom.

    None, with a warning that names the node, `owner`, where there are none.
    """
    values = _read_values(image, owner, "it is black", warn)
    if values is None:
        return None
    if values.shape[2] == 4 and values[..., 3].min() < 0.999:
        warn(f"{owner}: the transparency of image '{image.name}' isn't supported; its colours are used as they are")
    picture = _colors(values)
    if not image.is_float:
        picture = _to_linear(picture, image, owner, warn)
    if not (np.isfinite(picture).all() and picture.min() >= 0):
        warn(f"{owner}: pixels of image '{image.name}' that are negative or not finite count as 0")
        picture = np.where(np.isfinite(picture) & (picture > 0), picture, 0)
    return np.ascontiguousarray(picture, dtype=np.float32)


def read_texture(node: bpy.types.Node, owner: str, without: str, warn: Warn) -> np.ndarray | None:
    """The pixels (height, width, 4) of an Image Texture node's image, of a sequence those of its frame: linear float32 RGB,
    not premultiplied, and opacity, first row at the bottom.

    None, with a warning that names the node, `owner`, and ends in what becomes of that, `without`, where there are none.
    """
    image = node.image
    if image is None or image.source != "SEQUENCE":
        return _read_rgba(image, owner, without, warn)
    path = bpy.path.abspath(image.filepath_from_user(image_user=node.image_user), library=image.library)
    # Blender gives scripts no frame of a sequence: its file is loaded by itself, out of the user's sight.
    with bpy.data.temp_data() as data:
        try:
            frame = data.images.load(path)
        except RuntimeError as error:
            warn(f"{owner}: image '{image.name}': {str(error).strip()}; {without}")
            return None
        frame.colorspace_settings.name = image.colorspace_settings.name
        frame.alpha_mode = image.alpha_mode
        return _read_rgba(frame, owner, without, warn)


def _read_rgba(image: bpy.types.Image | None, owner: str, without: str, warn: Warn) -> np.ndarray | None:
    values = _read_values(image, owner, without, warn)
    if values is None:
        return None
    colors, opacity = _colors(values), np.ones(values.shape[:2], dtype=np.float32)
    if values.shape[2] == 4 and image.alpha_mode != "NONE":
        opacity = values[..., 3]
        # Blender keeps the colours of images in floats multiplied by their opacity, and of others as they are.
        if image.alpha_mode == "PREMUL" or (image.is_float and image.alpha_mode == "STRAIGHT"):
            colors = np.divide(colors, opacity[..., None], out=np.zeros_like(colors), where=opacity[..., None] > 0)
    if not image.is_float:
        colors = _to_linear(colors, image, owner, warn)
    return np.concatenate([colors, opacity[..., None]], axis=2).astype(np.float32, copy=False)


def _read_values(image: bpy.types.Image | None, owner: str, without: str, warn: Warn) -> np.ndarray | None:
    """The pixels (height, width, channels) float32 as Blender holds them, or None with a warning."""
    if image is None:
        warn(f"{owner} has no image; {without}")
        return None
    if image.source not in ("FILE", "GENERATED"):
        warn(f"{owner}: image '{image.name}' is of the kind {image.source}, which isn't supported; {without}")
        return None
    width, height = image.size
    if not (width and height and image.channels):
        warn(f"{owner}: image '{image.name}' can't be read; {without}")
        return None
    values = np.empty(width * height * image.channels, dtype=np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(height, width, image.channels)


def _colors(values: np.ndarray) -> np.ndarray:
    """The colours (height, width, 3) among the channels."""
    return values[..., :3] if values.shape[2] > 2 else np.repeat(values[..., :1], 3, axis=2)


def reduce(picture: np.ndarray, width: int) -> np.ndarray:
    """The picture (height, width, 3) at most `width` wide: means of blocks of pixels, weighted with their solid angles
    so that light is conserved."""
    step = -(-picture.shape[1] // width)
    rows, columns = np.arange(0, picture.shape[0], step), np.arange(0, picture.shape[1], step)
    edges = np.sin(np.pi * (np.arange(picture.shape[0] + 1) / picture.shape[0] - 0.5))
    weights = np.diff(edges)
    across = np.add.reduceat(picture, columns, axis=1, dtype=np.float64)
    across /= np.diff(np.append(columns, picture.shape[1]))[:, None]
    sums = np.add.reduceat(across * weights[:, None, None], rows, axis=0)
    return (sums / np.add.reduceat(weights, rows)[:, None, None]).astype(np.float32)


def _to_linear(picture: np.ndarray, image: bpy.types.Image, owner: str, warn: Warn) -> np.ndarray:
    space = image.colorspace_settings.name
    if space in _LINEAR:
        return picture
    if space != "sRGB":
        warn(f"{owner}: the colour space {space} of image '{image.name}' isn't supported; it counts as sRGB")
    return np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
