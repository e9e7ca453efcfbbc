# SPDX-License-Identifier: GPL-3.0-or-later
"""The world: what it looks like behind the smoke, and the light that comes from it."""

from __future__ import annotations

from dataclasses import dataclass, field

import bpy
import numpy as np

from .. import compat, core
from .image import read_picture, reduce
from .nodes import NodeReader, Warn

# Pixels of a picture's width that light is found from; what is seen behind the smoke isn't reduced.
_LIGHT_WIDTH = 1024


@dataclass
class World:
    """Light from all around; among the lights it comes last. Without a picture, `color` is the radiance (3,)."""

    name: str  # for messages
    owner: str = "World"  # as which its passes go
    group: str = ""  # of lights, "" if it is in none
    color: np.ndarray = field(default_factory=lambda: np.zeros(3))  # factors on the picture
    picture: np.ndarray | None = None  # (height, width, 3) float32, equirectangular, first row at the bottom
    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))  # (4, 4) world from picture
    on_smoke: bool = True  # shines on it...
    on_solids: bool = True  # ...and on them
    in_camera: bool = True  # the camera sees it
    light_sets: tuple[int, ...] | None = None  # that it shines on; None: all

    def add_to(self, scene: core.Scene) -> None:
        """Adds it as a light. Raises core.FumaroleError."""
        picture = self.picture
        if picture is not None and picture.shape[1] > _LIGHT_WIDTH:
            picture = reduce(picture, _LIGHT_WIDTH)
        scene.add_world(self.color, picture, self.matrix, self.name, light_sets=self.light_sets)

    def seen_by(self, camera: core.Camera) -> np.ndarray:
        """Radiance behind the smoke: (3,), or (height, width, 3) for each pixel of the camera."""
        if not self.in_camera:
            return np.zeros(3)
        if self.picture is None:
            return self.color
        return self.color * _look_up(self.picture, _directions(camera) @ np.linalg.inv(self.matrix)[:3, :3].T, camera)


def export_world(world: bpy.types.World | None, warn: Warn) -> World | None:
    """What a world shows; None if that is black."""
    if world is None:
        return None
    result = World(f"World '{world.name}'", group=getattr(world, "lightgroup", ""))
    if hasattr(world, "cycles_visibility"):
        result.on_smoke, result.on_solids = world.cycles_visibility.scatter, world.cycles_visibility.diffuse
        result.in_camera = world.cycles_visibility.camera
    tree = compat.node_tree(world)
    if tree is None:
        result.color = np.array(world.color, dtype=np.float64)
    elif not _read_nodes(tree, result, warn):
        return None
    if np.any(result.color < 0):
        shown = ", ".join(f"{channel:.4g}" for channel in result.color)
        warn(f"{result.name} has negative light ({shown}), which isn't supported; it is black")
        return None
    is_black = not np.any(result.color) or (result.picture is not None and not result.picture.any())
    return None if is_black else result


def _read_nodes(tree: bpy.types.NodeTree, world: World, warn: Warn) -> bool:
    """Fills in colour and picture; False if the background is black."""
    output = tree.get_output_node("CYCLES")
    reader = NodeReader(world.name, warn)
    node, groups = reader.shader(output.inputs["Surface"]) if output else (None, ())
    if node is None:
        return False
    if node.bl_idname not in ("ShaderNodeBackground", "ShaderNodeEmission"):
        warn(f"{world.name}: node '{node.name}' ({node.bl_label}) isn't supported; the background is black")
        return False
    strength = float(reader.number(node, "Strength", groups)[0])
    source, texture_groups = reader.shader(node.inputs["Color"], groups)
    if source is None or source.bl_idname != "ShaderNodeTexEnvironment":
        world.color = reader.color(node, "Color", groups)[0] * strength
        return True
    if source.projection != "EQUIRECTANGULAR":
        what = f"node '{source.name}' projects as {source.projection}"
        warn(f"{world.name}: {what}, which isn't supported; the background is black")
        return False
    world.picture = read_picture(source.image, f"{world.name}, node '{source.name}'", warn)
    world.color = np.full(3, strength)
    world.matrix[:3, :3] = np.linalg.inv(_picture_from_world(reader, source, texture_groups))
    return world.picture is not None


def _picture_from_world(reader: NodeReader, texture: bpy.types.Node, groups: tuple) -> np.ndarray:
    """The matrix (3, 3) that a texture's Vector input applies to directions: rotations and reflections."""
    result = np.eye(3)
    node, groups = reader.shader(texture.inputs["Vector"], groups)
    while node is not None and node.bl_idname == "ShaderNodeMapping":
        result = result @ _mapping(reader, node, groups)
        node, groups = reader.shader(node.inputs["Vector"], groups)
        if node is None:
            reader.warn(f"{reader.owner}: a Mapping node's input 'Vector' isn't linked; it gets the view's direction")
    if node is not None and node.bl_idname != "ShaderNodeTexCoord":
        what = f"node '{node.name}' ({node.bl_label})"
        reader.warn(f"{reader.owner}: {what} isn't supported; the picture isn't turned by it")
    return result


def _mapping(reader: NodeReader, node: bpy.types.Node, groups: tuple) -> np.ndarray:
    """What a Mapping node does to a direction, (3, 3)."""
    angles = reader.color(node, "Rotation", groups)[0].astype(np.float64)
    scale = reader.color(node, "Scale", groups)[0].astype(np.float64)
    is_moved = node.vector_type in ("POINT", "TEXTURE") and np.any(reader.color(node, "Location", groups))
    if is_moved or not np.allclose(np.abs(scale), np.abs(scale[0]), rtol=1e-5) or not scale.all():
        what = f"node '{node.name}' moves or stretches the picture"
        reader.warn(f"{reader.owner}: {what}, which isn't supported; it only turns it")
        scale = np.where(scale < 0, -1.0, 1.0)
    turn = _rotation(angles)
    mirror = np.diag(np.sign(scale))
    return mirror @ turn.T if node.vector_type == "TEXTURE" else turn @ mirror


def _rotation(angles: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) of Euler angles about X, then Y, then Z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def _directions(camera: core.Camera) -> np.ndarray:
    """Directions (height, width, 3) in which the camera's pixels look; not of length 1."""
    left, right, bottom, top = camera.window
    x = left + (right - left) * (np.arange(camera.width) + 0.5) / camera.width
    y = bottom + (top - bottom) * (np.arange(camera.height) + 0.5) / camera.height
    axes = camera.matrix[:3, :3] / np.linalg.norm(camera.matrix[:3, :3], axis=0)
    if camera.type == "ORTHOGRAPHIC":
        return np.broadcast_to(-axes[:, 2], (camera.height, camera.width, 3))
    return x[None, :, None] * axes[:, 0] + y[:, None, None] * axes[:, 1] - axes[:, 2]


def _look_up(picture: np.ndarray, directions: np.ndarray, camera: core.Camera) -> np.ndarray:
    """The picture (height, width, 3) in directions (..., 3), linear between its pixels as in Cycles."""
    if camera.type == "PERSPECTIVE":
        # Where pixels are wider than the picture's, those are averaged first.
        wide = (camera.window[1] - camera.window[0]) / camera.width
        most = max(8, int(2 * np.pi / wide))
        picture = reduce(picture, most) if picture.shape[1] > 1.5 * most else picture
    height, width = picture.shape[:2]
    x, y, z = np.moveaxis(directions, -1, 0)
    u = (0.5 - np.arctan2(y, x) / (2 * np.pi)) * width - 0.5
    v = (0.5 + np.arctan2(z, np.hypot(x, y)) / np.pi) * height - 0.5
    left, below = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    across, up = (u - left)[..., None].astype(np.float32), (v - below)[..., None].astype(np.float32)
    columns = left % width, (left + 1) % width
    rows = np.clip(below, 0, height - 1), np.clip(below + 1, 0, height - 1)
    lower = picture[rows[0], columns[0]] * (1 - across) + picture[rows[0], columns[1]] * across
    upper = picture[rows[1], columns[0]] * (1 - across) + picture[rows[1], columns[1]] * across
    return lower * (1 - up) + upper * up
