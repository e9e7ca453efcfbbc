# SPDX-License-Identifier: GPL-3.0-or-later
"""What the scripts of the example files share: clouds of points, objects, lights, the engine's name."""

from __future__ import annotations

from collections.abc import Callable

import bpy
from fields import Field, Fields, connect
from mathutils import Matrix, Vector

Attributes = dict[str, Field]  # of points, by name

PUFF_LOBES = 60
PUFF_GRAINS = 700  # in a lobe


def add_cloud(name: str, count: int, make: Callable[[Fields], Attributes], material: bpy.types.Material) -> None:
    """An object whose geometry nodes make `count` points with the attributes that `make` gives: position, radius, id and
    others by name."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.outputs.new("NodeSocketGeometry", "Geometry")
    fields = Fields(tree)
    attributes = make(fields)
    points = fields.points(count, attributes["position"], attributes["radius"])
    for key in sorted(attributes.keys() - {"position", "radius"}):
        kind = "INT" if key == "id" else "VECTOR" if attributes[key].is_vector else "FLOAT"
        points = fields.store(points, key, kind, attributes[key])
    paint = tree.nodes.new("GeometryNodeSetMaterial")
    paint.inputs["Material"].default_value = material
    connect(tree, paint, {"Geometry": points})
    tree.links.new(paint.outputs["Geometry"], tree.nodes.new("NodeGroupOutput").inputs[0])
    fields.arrange()
    owner = add_object(name, bpy.data.meshes.new(name), Matrix())
    owner.modifiers.new(name, "NODES").node_group = tree


def puff_points(fields: Fields, middle: Vector) -> Attributes:
    """Position (m), radius (m), density (1/m) and id of the points of a puff, which is made of lobes."""
    index = fields.index()
    lobe = (index / PUFF_GRAINS).floor()
    size = fields.random(lobe, 1, 0.25, 0.5)
    position = fields.vector(*middle)
    position += fields.direction(lobe, 2) * fields.vector(1.0, 0.75, 0.6) * fields.random(lobe, 3, 0.2, 0.95)
    position += fields.direction(index, 4) * (size * fields.random(index, 5, 0.0, 1.0) ** 0.4)
    for number, (length, amount) in enumerate(((0.8, 0.35), (0.3, 0.16), (0.12, 0.07))):
        position += fields.noise(position * (1.0 / length), index * 0.0 + 3.0 * number) * amount
    return {"position": position, "radius": 0.05 + 0.12 * size, "density": index * 0.0 + 0.95, "id": index}


def add_puff(name: str, middle: Vector) -> None:
    """Smoke about 2.5 m across."""
    count = PUFF_LOBES * PUFF_GRAINS
    add_cloud(name, count, lambda fields: puff_points(fields, middle), smoke_material("Smoke"))


def _material(name: str, shader: str, socket: str, color: tuple[float, float, float]) -> tuple:
    """A material of one shader, whose only output goes to the `socket` of the material's; the shader's node as well."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    node, output = nodes.new(shader), nodes.new("ShaderNodeOutputMaterial")
    node.inputs["Color"].default_value = (*color, 1.0)
    node.location.x = -300
    material.node_tree.links.new(node.outputs[0], output.inputs[socket])
    return material, node


def smoke_material(
    name: str, color: tuple[float, float, float] = (0.9, 0.9, 0.92), anisotropy: float = 0.4
) -> bpy.types.Material:
    """Smoke that scatters `color` of the light it meets, by default nine tenths and mostly forwards."""
    material, volume = _material(name, "ShaderNodeVolumePrincipled", "Volume", color)
    volume.inputs["Anisotropy"].default_value = anisotropy
    return material


def matt_material(name: str, color: tuple[float, float, float]) -> bpy.types.Material:
    """A matt surface."""
    return _material(name, "ShaderNodeBsdfDiffuse", "Surface", color)[0]


def box_mesh(name: str, boxes: list[tuple[Vector | Matrix, Vector]]) -> bpy.types.Mesh:
    """Boxes, each by its centre, or a matrix that places it, and its size."""
    corners = [Vector((x, y, z)) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    places = [place if isinstance(place, Matrix) else Matrix.Translation(place) for place, _ in boxes]
    vertices = [place @ (corner * size) for place, (_, size) in zip(places, boxes) for corner in corners]
    faces = [[8 * box + corner for corner in side] for box in range(len(boxes)) for side in sides]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    return mesh


def add_light(
    name: str, kind: str, power: float, color: tuple[float, float, float], matrix: Matrix
) -> bpy.types.Light:
    light = bpy.data.lights.new(name, kind)
    light.energy, light.color, light.shadow_soft_size = power, color, 0.0
    add_object(name, light, matrix)
    return light


def looking(place: Vector, target: Vector) -> Matrix:
    """The matrix of a light or camera at `place` that faces `target`, its X axis level."""
    return Matrix.Translation(place) @ (target - place).to_track_quat("-Z", "Y").to_matrix().to_4x4()


def add_object(name: str, data: bpy.types.ID, matrix: Matrix) -> bpy.types.Object:
    owner = bpy.data.objects.new(name, data)
    owner.matrix_world = matrix
    bpy.context.scene.collection.objects.link(owner)
    return owner


class FumaroleName(bpy.types.RenderEngine):
    """Blender lets a file name only an engine that is registered; this makes it so without the add-on."""

    bl_idname = "FUMAROLE"
    bl_label = "Fumarole"
