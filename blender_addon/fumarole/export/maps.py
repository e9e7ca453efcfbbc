# SPDX-License-Identifier: GPL-3.0-or-later
"""The image on a material's particles: what its AOV Output node named Map says of an image texture."""

from __future__ import annotations

import bpy
import numpy as np

from .image import read_texture
from .nodes import NodeReader, Warn, find_socket, upstream

_WITHOUT = "smoke has no map"


def read_map(node: bpy.types.Node, owner: str, warn: Warn) -> np.ndarray | None:
    """Colour and opacity (height, width, 4) float32, 0..1, first row at the bottom, that an AOV Output node is linked to.

    What isn't linked is 1. Function nodes are computed for each pixel. None, with a warning, where there is no image.
    """
    reader = _Textures(node, owner, warn)
    if reader.shape is None:
        return None
    height, width = reader.shape
    result = np.ones((height * width, 4), dtype=np.float32)
    if find_socket(node.inputs, "Color").is_linked:
        result[:, :3] = reader.nodes.color(node, "Color")
    if find_socket(node.inputs, "Value").is_linked:
        result[:, 3] = reader.nodes.number(node, "Value")
    limited = np.clip(np.nan_to_num(result), 0, 1)
    if np.abs(limited - result).max() > 1e-6:
        warn(f"{owner}: node '{node.name}' gets values that aren't within 0..1; they are limited to that")
    return limited.reshape(height, width, 4)


class _Textures:
    """The image textures that feed a node: all of the first one's size, `shape` (height, width); None without any."""

    def __init__(self, node: bpy.types.Node, owner: str, warn: Warn) -> None:
        self.owner, self.warn = owner, warn
        self.nodes = NodeReader(owner, warn, textures=self.read)
        self.shape: tuple[int, int] | None = None
        self._pixels: dict[int, np.ndarray | None] = {}
        sockets = (find_socket(node.inputs, name) for name in ("Color", "Value"))
        found = [item for socket in sockets for item in upstream(socket) if item.bl_idname == "ShaderNodeTexImage"]
        if not found:
            warn(f"{owner}: no Image Texture node is linked to node '{node.name}'; {_WITHOUT}")
            return
        first = self._read_image(found[0])
        self.shape = None if first is None else first.shape[:2]

    def read(self, node: bpy.types.Node, output: str) -> np.ndarray | None:
        """An output of an Image Texture node at each pixel, (n, 3) or (n,); None where it can't be read."""
        pixels = self._read_image(node)
        if pixels is None:
            return None
        if pixels.shape[:2] != self.shape:
            shown = " x ".join(str(side) for side in reversed(self.shape))
            self.warn(f"{self.owner}: image '{node.image.name}' isn't of the size of the map's first one, {shown} pixels")
            return None
        return pixels[..., 3].ravel() if output == "Alpha" else pixels[..., :3].reshape(-1, 3)

    def _read_image(self, node: bpy.types.Node) -> np.ndarray | None:
        key = node.as_pointer()  # nodes in different groups may have one name
        if key not in self._pixels:
            which = f"{self.owner}, node '{node.name}'"
            if find_socket(node.inputs, "Vector").is_linked:
                self.warn(f"{which}: its input 'Vector' isn't supported; the image fills the particle's square")
            if node.interpolation == "Closest":
                self.warn(f"{which}: interpolation Closest isn't supported; it is linear")
            self._pixels[key] = read_texture(node, which, _WITHOUT, self.warn)
        return self._pixels[key]
