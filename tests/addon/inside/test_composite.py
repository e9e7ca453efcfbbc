# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoke over a scene of Cycles, with its shadow: against the same scene with everything in Cycles."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "scripts"))

import compare_cycles  # noqa: E402
from fumarole import core  # noqa: E402

SIZE = 20
FLOOR = [(-4.0, -4.0, -1.2), (4.0, -4.0, -1.2), (4.0, 4.0, -1.2), (-4.0, 4.0, -1.2)]
HEIGHT, DISTANCE = 3.5, 7.0  # m, of the camera


def build() -> None:
    """The smoke, the wall and the lights of the comparison, over a grey floor, seen from above."""
    compare_cycles.build_blender_scene(SIZE, step=0.08)
    floor = compare_cycles.add_mesh("Floor", FLOOR, [(0, 1, 2, 3)], (0, 0, 0))
    grey = bpy.data.materials.new("Grey")
    grey.use_nodes = True
    tree = grey.node_tree
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (0.5, 0.5, 0.5, 1.0)
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    floor.data.materials.append(grey)
    scene = bpy.context.scene
    scene.camera.location = (0.0, -DISTANCE, HEIGHT)
    scene.camera.rotation_euler = (math.pi / 2 - math.atan2(HEIGHT, DISTANCE), 0, 0)
    scene.camera.data.lens = 60.0
    scene.cycles.max_bounces = 0


def mean_of_cycles(samples: int, runs: int) -> np.ndarray:
    return np.mean([compare_cycles.render_cycles(samples, 1001 * run) for run in range(runs)], axis=0)


def smoke() -> tuple[np.ndarray, np.ndarray]:
    """Combined (SIZE, SIZE, 4) and Shadow (SIZE, SIZE, 3) of the same smoke by Fumarole."""
    camera = bpy.context.scene.camera
    bpy.context.view_layer.update()
    with core.Context() as context:
        scene = core.Scene(context)
        gaussians = compare_cycles.GAUSSIANS
        scene.add_particles(
            gaussians[:, :3],
            radius=2 * gaussians[:, 3],
            density=gaussians[:, 4],
            albedo=compare_cycles.ALBEDO,
            anisotropy=compare_cycles.ANISOTROPY,
        )
        two = [(0, 1, 2), (0, 2, 3)]
        height = compare_cycles.placed((0, 0, compare_cycles.WALL_HEIGHT))
        scene.add_mesh(compare_cycles.WALL, two, matrix=height, visible_to_camera=False)
        scene.add_mesh(FLOOR, two)
        for kind, settings, location, _rotation in compare_cycles.LAMPS:
            scene.add_light(kind, matrix=compare_cycles.placed(location), cycles=bpy.app.version, **settings)
        matrix = np.array(camera.matrix_world.normalized())
        view = core.Camera(matrix=matrix, lens=camera.data.lens, width=SIZE, height=SIZE)
        settings = core.Settings(light_samples=256)
        result = core.render(scene, view, settings, ["Combined", "Shadow"])
        return result["Combined"].astype(float), result["Shadow"].astype(float)


def relative_rms(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.sqrt(((found - expected) ** 2).mean() / (expected**2).mean()))


def test_composite_is_what_cycles_renders_as_a_whole(scene: bpy.types.Scene) -> None:
    build()
    whole = mean_of_cycles(128, 6)[..., :3]
    bpy.data.objects.remove(bpy.data.objects["Smoke"])
    solids = mean_of_cycles(64, 3)[..., :3]
    combined, shadow = smoke()
    behind = 1.0 - combined[..., 3:]
    with_shadow = combined[..., :3] + behind * shadow * solids
    without_shadow = combined[..., :3] + behind * solids
    assert relative_rms(with_shadow, whole) < 0.03
    assert relative_rms(without_shadow, whole) > 0.1, "the shadow matters"
