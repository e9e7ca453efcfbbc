# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes cinematic.blend beside itself, after a ./run command has built the library:
blender -b --factory-startup --python scripts/blender_checkout.py --python example_blends/cinematic.py

Its pictures in docs/pictures, plain, with motion blur and with depth of field, are made by cinematic_pictures.py.

A Catherine wheel turns before a town at night. Sparks and smoke leave its nozzles; embers drift by close to the camera.
Where a point is, and how fast it moves, depends on nothing but the frame, so any frame and any part of one is right.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).parent))
from fields import Field, Fields  # noqa: E402
from staging import (  # noqa: E402
    Attributes,
    add_cloud,
    add_light,
    add_object,
    box_mesh,
    looking,
    matt_material,
    smoke_material,
)

FRAMES = (1, 48)
FRONT_FRAME = 20  # the one that the file opens at
FRAME_RATE = 24

MIDDLE = Vector((0.35, 0.0, 2.15))  # of the wheel
RADIUS = 0.95  # m, of the wheel
TURN = 0.26  # radians a frame
NOZZLES = 3
EYE = Vector((-0.3, -7.6, 1.55))

SPARKS = 5000
SPARK_LIFE = 22.0  # frames
SPARK_SPEED = 0.3  # m a frame
SMOKE_POINTS = 60_000
SMOKE_LIFE = 60.0  # frames
TOWN_LIGHTS = 90
EMBERS = 18


class Birth:
    """What leaves the nozzles evenly over time: when a point left, and from where."""

    def __init__(self, fields: Fields, life: float, number: int) -> None:
        index, frame = fields.index(), fields.frame()
        clock = frame / life + fields.random(index, 1, 0.0, 1.0)
        cycle = clock.floor()
        self.age = (clock - cycle) * life  # frames
        self.ident = index + cycle * number
        angle = (frame - self.age) * TURN + (index - (index / NOZZLES).floor() * NOZZLES) * (2 * math.pi / NOZZLES)
        self.outwards = fields.vector(angle.cos(), 0.0, angle.sin())
        self.backwards = fields.vector(angle.sin(), 0.0, 0.0 - angle.cos())  # against the turn
        self.place = fields.vector(*MIDDLE) + self.outwards * RADIUS


def spark_points(fields: Fields) -> Attributes:
    """Thrown off against the turn, slowed down by the air, drawn down by gravity."""
    birth = Birth(fields, SPARK_LIFE, SPARKS)
    age, ident = birth.age, birth.ident
    way = birth.backwards + birth.outwards * fields.random(ident, 2, 0.1, 0.5) + fields.direction(ident, 3) * 0.22
    thrown = way * (SPARK_SPEED * fields.random(ident, 4, 0.45, 1.0))
    drag, gravity = 0.09, fields.vector(0.0, 0.0, -9.81 / FRAME_RATE**2)
    slowing = 1.0 + age * drag
    position = birth.place + thrown * (slowing.log() / drag) + gravity * (age * age * 0.5)
    velocity = thrown / slowing + gravity * age
    share = age / (SPARK_LIFE * fields.random(ident, 5, 0.35, 1.0))
    return {
        "position": position,
        "velocity": velocity * FRAME_RATE,
        "radius": 0.014 * (1.0 - share.smoothstep(0.5, 1.0)) * fields.random(ident, 6, 0.6, 1.2),
        "age": share,
        "id": ident,
    }


def smoke_points(fields: Fields) -> Attributes:
    """Slowed down close to the nozzles, then carried up and away by warm air that swirls."""
    now, later = (smoke_place(fields, Birth(fields, SMOKE_LIFE, SMOKE_POINTS), step) for step in (0.0, 0.5))
    birth = Birth(fields, SMOKE_LIFE, SMOKE_POINTS)
    share = birth.age / SMOKE_LIFE
    return {
        "position": now,
        "velocity": (later - now) * (2.0 * FRAME_RATE),
        "radius": 0.05 + 0.26 * share,
        "density": 0.16 * (1.0 - share.smoothstep(0.35, 1.0)) * share.smoothstep(0.0, 0.03) / (1.0 + share * 8.0),
        "id": birth.ident,
    }


def smoke_place(fields: Fields, birth: Birth, step: float) -> Field:
    """Where points of smoke are `step` frames from now."""
    age, ident = birth.age + step, birth.ident
    way = birth.backwards + birth.outwards * 0.35 + fields.direction(ident, 12) * 0.4
    slowing = 1.0 + age * 0.35
    position = birth.place + way * (slowing.log() * 0.42 * fields.random(ident, 13, 0.4, 1.0))
    position += fields.direction(ident, 14) * (age * 0.006)
    position += fields.vector(0.012, 0.006, 0.021) * age
    for number, (size, amount) in enumerate(((1.0, 0.016), (0.42, 0.011), (0.17, 0.005))):
        time = (fields.frame() + step) * (0.012 * (number + 1))
        position += fields.noise(position * (1.0 / size), time) * (age * amount)
    return position


def town_points(fields: Fields) -> Attributes:
    """Lamps far behind the wheel."""
    index = fields.index()
    across = fields.random(index, 21, -15.0, 15.0)
    away = fields.random(index, 22, 24.0, 40.0)
    height = 0.3 + 5.0 * fields.random(index, 23, 0.0, 1.0) ** 2.2
    return {
        "position": fields.vector(across, away, height),
        "radius": 0.035 + fields.random(index, 24, 0.0, 0.02),
        "age": fields.random(index, 25, 0.0, 1.0),
        "id": index,
    }


def ember_points(fields: Fields) -> Attributes:
    """Embers that drift past between the wheel and the camera."""
    index, frame = fields.index(), fields.frame()
    start = fields.vector(
        fields.random(index, 31, -1.9, 1.5), fields.random(index, 32, -6.2, -3.2), fields.random(index, 33, 0.7, 2.7)
    )
    drift = fields.vector(0.006, 0.002, 0.01) + fields.direction(index, 34) * 0.006
    return {
        "position": start + drift * frame,
        "velocity": drift * FRAME_RATE,
        "radius": 0.004 + fields.random(index, 35, 0.0, 0.003),
        "age": fields.random(index, 36, 0.25, 0.7),
        "id": index,
    }


def glowing(name: str, stops: tuple[tuple[float, tuple[float, float, float]], ...], strength: float) -> bpy.types.Material:
    """Emits by the attribute `age`, and absorbs next to nothing."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    age, colors = tree.nodes.new("ShaderNodeAttribute"), tree.nodes.new("ShaderNodeValToRGB")
    volume, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    age.attribute_name = "age"
    ramp = colors.color_ramp
    while len(ramp.elements) < len(stops):
        ramp.elements.new(0.5)
    for element, (place, color) in zip(ramp.elements, stops):
        element.position, element.color = place, (*color, 1.0)
    volume.inputs["Density"].default_value = 0.5
    volume.inputs["Emission Strength"].default_value = strength
    for node, place in ((age, -900), (colors, -600), (volume, -300)):
        node.location.x = place
    tree.links.new(age.outputs["Fac"], colors.inputs["Fac"])
    tree.links.new(colors.outputs["Color"], volume.inputs["Emission Color"])
    tree.links.new(volume.outputs["Volume"], output.inputs["Volume"])
    return material


def wheel_mesh() -> bpy.types.Mesh:
    """Spokes, a rim and nozzles in the plane of X and Z."""
    pieces = [(Matrix(), Vector((0.16, 0.12, 0.16)))]
    for number in range(3):
        turn = Matrix.Rotation(-number * math.pi / 3, 4, "Y")
        pieces.append((turn, Vector((2 * RADIUS, 0.035, 0.045))))
    count = 36
    for number in range(count):
        turn = Matrix.Rotation(-(number + 0.5) * 2 * math.pi / count, 4, "Y")
        length = 2 * RADIUS * math.tan(math.pi / count) + 0.01
        pieces.append((turn @ Matrix.Translation((RADIUS - 0.03, 0, 0)), Vector((0.035, 0.05, length))))
    for number in range(NOZZLES):
        turn = Matrix.Rotation(-number * 2 * math.pi / NOZZLES, 4, "Y")
        pieces.append((turn @ Matrix.Translation((RADIUS, 0, 0.08)), Vector((0.075, 0.075, 0.24))))
    mesh = box_mesh("Wheel", pieces)
    mesh.materials.append(matt_material("Wood", (0.32, 0.2, 0.11)))
    return mesh


def add_solids() -> None:
    wheel = add_object("Wheel", wheel_mesh(), Matrix.Translation(MIDDLE))
    # Linear, and known at parts of frames. Y turns X towards -Z, the nozzles' angle grows from X towards Z.
    turn = wheel.driver_add("rotation_euler", 1).driver
    turn.expression = f"-{TURN} * frame"
    post = box_mesh("Post", [(Vector((MIDDLE.x, 0.14, MIDDLE.z / 2)), Vector((0.11, 0.09, MIDDLE.z + 0.1)))])
    post.materials.append(matt_material("Post", (0.14, 0.1, 0.07)))
    add_object("Post", post, Matrix())
    ground = bpy.data.meshes.new("Ground")
    ground.from_pydata([(-60, -12, 0), (60, -12, 0), (60, 60, 0), (-60, 60, 0)], [], [(0, 1, 2, 3)])
    ground.materials.append(matt_material("Ground", (0.05, 0.05, 0.055)))
    floor = add_object("Ground", ground, Matrix())
    # Their shadows in so thin a haze would hardly be seen, and are looked for in every pixel.
    for owner in (wheel, bpy.data.objects["Post"], floor):
        owner.visible_shadow = False


def add_lights() -> None:
    """The glow of the sparks, and a cool light from behind."""
    glow = add_light("Glow", "POINT", 260.0, (1.0, 0.56, 0.22), Matrix.Translation(MIDDLE + Vector((0.0, -0.45, 0.0))))
    glow.shadow_soft_size = 0.35
    add_light("Night", "POINT", 2600.0, (0.4, 0.6, 1.0), Matrix.Translation((-5.5, 7.0, 6.0)))


def add_camera() -> None:
    lens = bpy.data.cameras.new("Camera")
    lens.lens = 42.0
    lens.dof.focus_distance = (MIDDLE - EYE).length
    lens.dof.aperture_fstop = 0.24
    lens.dof.aperture_blades = 6
    lens.dof.use_dof = False  # on in one of the pictures
    bpy.context.scene.camera = add_object("Camera", lens, looking(EYE, MIDDLE + Vector((-0.25, 0.0, -0.1))))


def set_scene() -> None:
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = FRAMES
    scene.frame_current = FRONT_FRAME
    scene.render.fps = FRAME_RATE
    scene.world = bpy.data.worlds.new("Night")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.004, 0.007, 0.014, 1.0)
    scene.world.cycles_visibility.scatter = scene.world.cycles_visibility.diffuse = False
    scene.render.resolution_x, scene.render.resolution_y = 960, 540
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = 0.5
    scene.fumarole.blur_samples = 6  # the wheel's edge in steps of about two pixels at the pictures' size
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.compression = "PNG", "RGB", 100
    scene.view_settings.view_transform = "Filmic"
    scene.view_settings.look = "Medium High Contrast"
    scene.render.engine = "FUMAROLE"
    scene.fumarole.solids = "SHADED"
    scene.fumarole.tolerance = 0.03


def main() -> None:
    if bpy.app.version[:2] != (3, 4):
        raise SystemExit(f"Blender {bpy.app.version_string} would write a file that 3.4 can't read: use 3.4")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    sparks = ((0.0, (1.0, 0.8, 0.5)), (0.3, (1.0, 0.52, 0.16)), (0.65, (0.9, 0.2, 0.03)), (1.0, (0.1, 0.01, 0.0)))
    lamps = ((0.0, (1.0, 0.6, 0.25)), (0.6, (1.0, 0.85, 0.6)), (0.8, (0.6, 0.8, 1.0)), (0.95, (1.0, 0.2, 0.12)))
    add_cloud("Sparks", SPARKS, spark_points, glowing("Spark", sparks, 1600.0))
    add_cloud("Wheel smoke", SMOKE_POINTS, smoke_points, smoke_material("Smoke", (0.86, 0.86, 0.88), 0.3))
    add_cloud("Town", TOWN_LIGHTS, town_points, glowing("Lamp", lamps, 500.0))
    add_cloud("Embers", EMBERS, ember_points, glowing("Ember", sparks, 4000.0))
    add_solids()
    add_lights()
    add_camera()
    set_scene()
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(__file__).with_suffix(".blend")), compress=True)


main()
