# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes plume.blend beside itself, after a ./run command has built the library:
blender -b --factory-startup --python scripts/blender_checkout.py --python example_blends/plume.py

docs/pictures/plume.png is its frame 18, from the top of the checkout:
./run render example_blends/plume.blend -o "$PWD/out/plume_####" --python-expr \\
  "import bpy; bpy.context.scene.render.use_stamp_filename = False" -f 18 && cp out/plume_0018.png docs/pictures/plume.png

The smoke is made of points by geometry nodes. Where a point is depends on nothing but the frame, so any frame is right
in any order and the file needs no simulation cache.

A plume of puffs rises from the ground. Each puff carries lobes, each lobe carries grains, which are the points.
Puffs leave the ground at a steady rate, rise, grow and roll over outwards, as hot smoke does; noise folds their edges.
A spot shines through a lattice whose shadow is seen in thin haze and on the plume.
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

FRAMES = (1, 40)
FRONT_FRAME = 18  # the one that the file opens at

# Three levels of the plume: their product is the number of its points.
PUFFS = 70
LOBES = 70  # in a puff
GRAINS = 68  # in a lobe
HAZE_POINTS = 50_000

LIFE = 200.0  # frames that a puff takes from the ground to the top
HEIGHT = 5.6  # m, of a puff at the end of its life
FOOT_RADIUS = 0.24  # m, of the plume at the ground
SPREAD = 0.2  # growth of the plume's radius per metre of height
WIND = 1.9  # m, how far the plume leans at its full height

SPOT = Vector((-6.5, 0.2, 7.0))
TARGET = Vector((0.6, 0.0, 2.6))  # the plume's middle
EYE = Vector((-0.2, -10.4, 1.7))

def plume_points(fields: Fields) -> Attributes:
    """Position (m), radius (m), density (1/m) and id of the plume's points."""
    index, frame = fields.index(), fields.frame()
    puff = (index / (LOBES * GRAINS)).floor()
    lobe = (index / GRAINS).floor()

    # A puff that has reached the top leaves the ground again as another one.
    clock = frame / LIFE + (puff + 0.5) / PUFFS
    cycle = clock.floor()
    age = clock - cycle  # 0..1
    puff_id = puff + cycle * PUFFS
    lobe_id = lobe + cycle * (PUFFS * LOBES)
    grain_id = index + cycle * (PUFFS * LOBES * GRAINS)

    height = HEIGHT * age**0.8 * fields.random(puff_id, 1, 0.93, 1.07)
    lean = WIND * (height / HEIGHT) ** 1.5
    girth = FOOT_RADIUS + SPREAD * height  # the plume's radius

    # The outer side of a puff falls behind: it rolls about the horizontal axis square to the way outwards.
    turn = fields.random(puff_id, 2, 0.0, 2 * math.pi) + 0.8 * height
    outwards = fields.vector(turn.cos(), turn.sin(), 0.0)
    axis = fields.vector(0.0 - turn.sin(), turn.cos(), 0.0)
    roll = 3.0 * (1.0 + 4.0 * age).log()

    puff_radius = girth * fields.random(puff_id, 3, 0.5, 0.85)
    lobe_radius = puff_radius * fields.random(lobe_id, 4, 0.15, 0.4)
    # Points are spent where they are seen: outwards in the plume, in the puffs and in the lobes.
    lobe_way = fields.direction(lobe_id, 5).rotate(axis, roll) + outwards * 0.6
    grain_way = fields.direction(grain_id, 6) + lobe_way * 0.5
    position = fields.vector(lean, 0.0, height)
    position += outwards * (girth * 0.75 * fields.random(puff_id, 7, 0.0, 1.0) ** 0.35)
    position += lobe_way * (puff_radius * fields.random(lobe_id, 8, 0.5, 0.85))
    position += grain_way * (lobe_radius * fields.random(grain_id, 9, 0.0, 1.0) ** 0.3)

    fade = age.smoothstep(0.0, 0.02) * (1.0 - age.smoothstep(0.72, 1.0))
    return {
        "position": fold(fields, position, fields.vector(lean, 0.0, frame * (HEIGHT / LIFE)), girth),
        "radius": lobe_radius * 0.36,
        "density": fade * 1.2 / girth,
        "id": grain_id,
    }


def fold(fields: Fields, position: Field, travel: Field, girth: Field) -> Field:
    """Positions shifted by noise of several sizes that travels with the smoke and changes on its way."""
    start = position - travel
    octaves = ((1.1, 0.6), (0.5, 0.4), (0.22, 0.22), (0.1, 0.1))  # m, share of the plume's radius
    for number, (size, amount) in enumerate(octaves):
        time = fields.frame() * (0.02 * (number + 1))
        position += fields.noise(start * (1.0 / size), time) * (girth * amount)
    return position


def haze_points(fields: Fields) -> Attributes:
    """Position (m), radius (m), density (1/m) and id of the thin smoke in the spot's beam before the plume."""
    index = fields.index()
    away = fields.random(index, 21, 0.03, 1.5) ** (1 / 3)  # from the spot; 1 at its target
    span = (TARGET - SPOT).length
    right, up, back = (fields.vector(*axis) for axis in beam_axes())
    across = right * fields.random(index, 22, -0.12, 0.16) + up * fields.random(index, 23, -0.27, 0.27)
    position = fields.vector(*SPOT) + (across - back) * (away * span)

    start = position - fields.vector(fields.frame() * 0.006, 0.0, fields.frame() * 0.012)
    wisps = fields.noise(start * 0.9, fields.frame() * 0.005).length()
    density = 0.017 * wisps * (1.0 - away.smoothstep(0.7, 1.15))
    return {"position": position, "radius": 0.1 + 0.09 * away, "density": density, "id": index}


def add_solids() -> None:
    """The ground, and a lattice in the spot's beam whose bars point at the camera, so that their shadows look sharp."""
    ground = bpy.data.meshes.new("Ground")
    ground.from_pydata([(-30, -30, 0), (30, -30, 0), (30, 30, 0), (-30, 30, 0)], [], [(0, 1, 2, 3)])
    ground.materials.append(matt_material("Ground", (0.025, 0.025, 0.025)))
    add_object("Ground", ground, Matrix())
    bars = [(Vector((0.0, 0.75 * k, 0.0)), Vector((3.4, 0.18, 0.05))) for k in range(-2, 3)]
    posts = [(Vector((x, 0.0, 0.0)), Vector((0.14, 3.2, 0.1))) for x in (-1.7, 1.7)]
    place = Matrix.Translation(SPOT.lerp(TARGET, 0.56))
    lattice = box_mesh("Lattice", bars + posts)
    lattice.materials.append(matt_material("Lattice", (0.05, 0.05, 0.05)))
    add_object("Lattice", lattice, place @ Matrix(beam_axes()).transposed().to_4x4())


def beam_axes() -> tuple[Vector, Vector, Vector]:
    """Unit vectors across the spot's beam, first the one away from the camera, then along it, towards the spot."""
    back = (SPOT - TARGET).normalized()
    view = SPOT.lerp(TARGET, 0.6) - EYE
    right = (view - back * view.dot(back)).normalized()
    return right, back.cross(right), back


def add_lights() -> None:
    """A white spot past the lattice, the glow of a fire at the foot, and cool light from the far side."""
    spot = add_light("Spot", "SPOT", 10_000.0, (1.0, 0.93, 0.82), looking(SPOT, TARGET))
    spot.spot_size, spot.spot_blend = math.radians(40), 0.3
    add_light("Glow", "POINT", 190.0, (1.0, 0.42, 0.14), Matrix.Translation((0.6, -1.0, 0.15)))
    add_light("Rim", "POINT", 1100.0, (0.35, 0.6, 1.0), Matrix.Translation((5.5, 0.8, 4.5)))


def add_camera() -> None:
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 40.0
    bpy.context.scene.camera = add_object("Camera", camera, looking(EYE, Vector((-0.15, 0.0, 2.7))))


def set_scene() -> None:
    """Frames, picture, background and the engine."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = FRAMES
    scene.frame_current = FRONT_FRAME
    scene.world = bpy.data.worlds.new("Night")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.006, 0.008, 0.012, 1.0)
    # So dark a sky is seen, but lights nothing that could be seen: that saves its directions.
    scene.world.cycles_visibility.scatter = scene.world.cycles_visibility.diffuse = False
    scene.render.resolution_x, scene.render.resolution_y = 1280, 720
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.compression = "PNG", "RGB", 100
    scene.view_settings.view_transform = "Filmic"
    scene.view_settings.look = "Medium High Contrast"
    scene.render.engine = "FUMAROLE"
    scene.fumarole.solids = "SHADED"


def main() -> None:
    if bpy.app.version[:2] != (3, 4):
        raise SystemExit(f"Blender {bpy.app.version_string} would write a file that 3.4 can't read: use 3.4")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_cloud("Plume", PUFFS * LOBES * GRAINS, plume_points, smoke_material("Smoke"))
    add_cloud("Haze", HAZE_POINTS, haze_points, smoke_material("Haze"))
    add_solids()
    add_lights()
    add_camera()
    set_scene()
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(__file__).with_suffix(".blend")), compress=True)


main()
