# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds small scenes, exports them as a render would, and renders them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import radians
from pathlib import Path

import bpy
import numpy as np
from exr import read_exr, stack
from fumarole import core
from fumarole.export.camera import export_camera
from fumarole.export.scene import Scene, export_scene


def link(
    name: str, data: bpy.types.ID | None, location: tuple = (0, 0, 0), rotation: tuple = (0, 0, 0)
) -> bpy.types.Object:
    """A new object in the scene; the rotation is in degrees."""
    result = bpy.data.objects.new(name, data)
    result.location = location
    result.rotation_euler = [radians(angle) for angle in rotation]
    bpy.context.scene.collection.objects.link(result)
    return result


def plane(name: str, size: float = 2.0, **placed: tuple) -> bpy.types.Object:
    """A square in the xy plane."""
    mesh = bpy.data.meshes.new(name)
    half = size / 2
    corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    return link(name, mesh, **placed)


def camera(location: tuple = (0, -8, 0), rotation: tuple = (90, 0, 0), **settings: object) -> bpy.types.Object:
    """The scene's camera, by default looking along y."""
    data = bpy.data.cameras.new("Camera")
    for name, value in settings.items():
        setattr(data, name, value)
    bpy.context.scene.camera = link("Camera", data, location, rotation)
    return bpy.context.scene.camera


def light(
    kind: str = "POINT",
    energy: float = 1000.0,
    location: tuple = (0, 0, 5),
    rotation: tuple = (0, 0, 0),
    **settings: object,
) -> bpy.types.Object:
    """A light, shining down by default; settings are those of its data."""
    data = bpy.data.lights.new(kind.title(), kind)
    data.energy = energy
    for name, value in settings.items():
        setattr(data, name, value)
    return link(kind.title(), data, location, rotation)


def emitter(name: str = "Emitter", count: int = 300, **settings: object) -> bpy.types.Object:
    """A plane whose particles all live from frame 1 on and rise at 1 m/s, without gravity."""
    owner = plane(name)
    owner.modifiers.new("Smoke", "PARTICLE_SYSTEM")
    system = owner.particle_systems[0]
    defaults = {
        "count": count,
        "frame_start": 1,
        "frame_end": 1,
        "lifetime": 100,
        "normal_factor": 1.0,
        "particle_size": 0.2,
    }
    for key, value in {**defaults, **settings}.items():
        setattr(system.settings, key, value)
    system.settings.effector_weights.gravity = 0
    return owner


def material(
    name: str, kind: str | None = "ShaderNodeVolumePrincipled", surface: bool = False, **inputs: object
) -> bpy.types.Material:
    """A material whose volume is one node with those inputs (`_` for a space)."""
    result = bpy.data.materials.new(name)
    result.use_nodes = True
    tree = result.node_tree
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    if not surface:
        for entry in list(output.inputs["Surface"].links):
            tree.links.remove(entry)
    if kind is not None:
        node = tree.nodes.new(kind)
        for key, value in inputs.items():
            node.inputs[key.replace("_", " ")].default_value = value
        tree.links.new(node.outputs[0], output.inputs["Volume"])
    return result


def paint(owner: bpy.types.Object, kind: str = "ShaderNodeBsdfDiffuse", **inputs: object) -> bpy.types.Material:
    """Gives an object a material whose surface is one node with those inputs (`_` for a space)."""
    result = material(f"Paint of {owner.name}", None)
    tree = result.node_tree
    node = tree.nodes.new(kind)
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    output = next(item for item in tree.nodes if item.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    owner.data.materials.append(result)
    return result


def cube(name: str, half: float, location: tuple, rotation: tuple = (0, 0, 0)) -> bpy.types.Object:
    corners = [(x, y, z) for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    mesh = bpy.data.meshes.new(name)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh.from_pydata(corners, [], faces)
    return link(name, mesh, location, rotation)


def put_in(owner: bpy.types.Object, name: str, **flags: bool) -> None:
    """Moves an object to a new collection whose layer has those flags."""
    collection = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(collection)
    bpy.context.scene.collection.objects.unlink(owner)
    collection.objects.link(owner)
    for flag, value in flags.items():
        setattr(bpy.context.view_layer.layer_collection.children[name], flag, value)


def points_by_nodes(
    name: str, positions: list[tuple], radius: float = 0.3, attributes: dict[str, tuple] | None = None
) -> bpy.types.Object:
    """An object whose geometry nodes make a point of every vertex; attributes: name -> (type, values)."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(positions, [], [])
    for key, (kind, values) in (attributes or {}).items():
        field = {"FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color"}.get(kind, "value")
        mesh.attributes.new(key, kind, "POINT").data.foreach_set(field, np.ravel(values))
    owner = link(name, mesh)
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    if hasattr(tree, "interface"):
        for direction in ("INPUT", "OUTPUT"):
            tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    else:
        tree.inputs.new("NodeSocketGeometry", "Geometry")
        tree.outputs.new("NodeSocketGeometry", "Geometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    convert = tree.nodes.new("GeometryNodeMeshToPoints")
    convert.inputs["Radius"].default_value = radius
    tree.links.new(start.outputs[0], convert.inputs[0])
    tree.links.new(convert.outputs[0], end.inputs[0])
    owner.modifiers.new("Points", "NODES").node_group = tree
    return owner


def set_point_material(owner: bpy.types.Object, chosen: bpy.types.Material) -> None:
    """Puts a Set Material node behind the points of points_by_nodes()."""
    tree = owner.modifiers["Points"].node_group
    end = next(node for node in tree.nodes if node.bl_idname == "NodeGroupOutput")
    setter = tree.nodes.new("GeometryNodeSetMaterial")
    setter.inputs["Material"].default_value = chosen
    before = end.inputs[0].links[0].from_socket
    tree.links.new(before, setter.inputs["Geometry"])
    tree.links.new(setter.outputs[0], end.inputs[0])


def bake() -> None:
    bpy.ops.ptcache.bake_all(bake=True)


@dataclass
class Export:
    """What a render of one view layer exported."""

    scene: Scene
    camera: core.Camera


class _CaptureEngine(bpy.types.RenderEngine):
    """Exports like Fumarole and hands back an empty picture."""

    bl_idname = "FUMAROLE_CAPTURE"
    bl_label = "Capture"
    look: Callable[[bpy.types.Depsgraph, Scene], None] | None = None
    captured: list[Export] = []

    def __init__(self, *arguments: object, **keywords: object) -> None:
        super().__init__(*arguments, **keywords)

    def update(self, data, depsgraph) -> None:
        exported = export_scene(depsgraph)
        owner = depsgraph.scene.camera
        matrix = np.array(self.camera_model_matrix(owner))
        layer = depsgraph.view_layer_eval
        view = export_camera(owner, depsgraph.scene, layer, matrix, self.camera_shift_x(owner), exported.warn)
        _CaptureEngine.captured.append(Export(exported, view))
        if _CaptureEngine.look:
            _CaptureEngine.look(depsgraph, exported)

    def render(self, depsgraph) -> None:
        self.end_result(self.begin_result(0, 0, self.resolution_x, self.resolution_y))


def export_layers(look: Callable[[bpy.types.Depsgraph, Scene], None] | None = None) -> list[Export]:
    """Exports the current scene as F12 would, every view layer; `look` sees depsgraph and export while they live."""
    scene = bpy.context.scene
    if scene.camera is None:
        camera()
    bpy.utils.register_class(_CaptureEngine)
    _CaptureEngine.captured, _CaptureEngine.look = [], look
    engine = scene.render.engine
    try:
        scene.render.engine = _CaptureEngine.bl_idname
        bpy.ops.render.render()
    finally:
        scene.render.engine = engine
        bpy.utils.unregister_class(_CaptureEngine)
    assert _CaptureEngine.captured, "the exporter raised; its message is above"
    return _CaptureEngine.captured


def export() -> Scene:
    """Exports the only view layer of the current scene."""
    (result,) = export_layers()
    return result.scene


def exr_output(path: Path, multilayer: bool = False) -> None:
    """Makes the scene write uncompressed 32-bit EXR files at `path`."""
    render = bpy.context.scene.render
    settings = render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE" if multilayer else "IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER" if multilayer else "OPEN_EXR"
    if hasattr(settings, "use_exr_interleave"):
        settings.use_exr_interleave = True
    settings.color_mode = "RGBA"
    settings.color_depth = "32"
    settings.exr_codec = "NONE"
    render.filepath = str(path)


def render_channels(folder: Path) -> dict[str, np.ndarray]:
    """Renders the current frame to a multilayer EXR file and reads all its channels."""
    exr_output(folder / "render.exr", multilayer=True)
    bpy.ops.render.render(write_still=True)
    return read_exr(folder / "render.exr")


def render_combined(folder: Path) -> np.ndarray:
    """Renders the current frame: (height, width, 4) premultiplied, first row at the bottom."""
    return stack(render_channels(folder), f"{bpy.context.view_layer.name}.Combined", "RGBA")
