# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares the reference with Cycles, which integrates the same physics by other means.

    blender -b --factory-startup --python scripts/compare_cycles.py -- FOLDER

The smoke is a few Gaussians written in shader nodes: the density of a Principled Volume in a cube is their sum. Without
volume bounces Cycles gives single scattering, with noise. Several renders with different seeds tell how much noise: what
is left of the difference when pixels are averaged must be as small as that noise allows.

Prints a JSON line and writes FOLDER/cycles_and_reference.png: Cycles, the reference, and their difference by pixels and
by squares of pixels, enlarged.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "blender_addon"))

from fumarole import core  # noqa: E402

# x, y, z, sigma (m), density at the centre (1/m)
GAUSSIANS = np.array(
    [
        (0.0, 0.0, 0.0, 0.45, 1.5),
        (0.5, -0.3, 0.35, 0.25, 4.0),
        (-0.55, 0.25, 0.2, 0.3, 3.0),
        (0.15, -0.55, -0.45, 0.22, 6.0),
        (-0.3, 0.4, -0.5, 0.35, 2.0),
    ]
)
ALBEDO = (0.9, 0.7, 0.5)
ANISOTROPY = 0.4
CUBE = 6.0  # m, side of the cube that holds the smoke
LENS = 85.0
CAMERA = (0.0, -7.0, 0.0)
WALL = [(-0.8, -1.0, 0.0), (0.1, -1.0, 0.0), (0.1, 1.0, 0.0), (-0.8, 1.0, 0.0)]
WALL_HEIGHT = 2.0
LAMPS = (
    ("POINT", {"power": 900.0, "color": (1.0, 0.9, 0.8)}, (3.0, 1.5, 1.0), (0.0, 0.0, 0.0)),
    ("AREA", {"power": 700.0, "color": (0.7, 0.85, 1.0), "size": 1.0}, (-0.3, 0.1, 4.0), (0.0, 0.0, 0.0)),
)


# Makes a volume shader in a tree: its output, given the socket that its extinction is to grow with (None: 1).
Shade = Callable[[bpy.types.NodeTree, "bpy.types.NodeSocket | None"], bpy.types.NodeSocket]


def grey_shade(tree: bpy.types.NodeTree, density: bpy.types.NodeSocket | None) -> bpy.types.NodeSocket:
    """Extinction that is the same for red, green and blue."""
    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
    volume.inputs["Color"].default_value = (*ALBEDO, 1.0)
    volume.inputs["Anisotropy"].default_value = ANISOTROPY
    if density is not None:
        tree.links.new(density, volume.inputs["Density"])
    return volume.outputs[0]


def smoke_material(shade: Shade) -> bpy.types.Material:
    """A volume of which the density is the sum of the Gaussians."""
    material = bpy.data.materials.new("Smoke")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    link = tree.links.new
    position = tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"]
    total = None
    for x, y, z, sigma, density in GAUSSIANS:
        offset, squared = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeVectorMath")
        offset.operation, squared.operation = "SUBTRACT", "DOT_PRODUCT"
        offset.inputs[1].default_value = (x, y, z)
        link(position, offset.inputs[0])
        link(offset.outputs["Vector"], squared.inputs[0])
        link(offset.outputs["Vector"], squared.inputs[1])
        exponent, power, term = (tree.nodes.new("ShaderNodeMath") for _ in range(3))
        exponent.operation, power.operation, term.operation = "MULTIPLY", "EXPONENT", "MULTIPLY_ADD"
        exponent.inputs[1].default_value = -1.0 / (2.0 * sigma**2)
        term.inputs[1].default_value, term.inputs[2].default_value = density, 0.0
        link(squared.outputs["Value"], exponent.inputs[0])
        link(exponent.outputs[0], power.inputs[0])
        link(power.outputs[0], term.inputs[0])
        if total is not None:
            link(total, term.inputs[2])
        total = term.outputs[0]
    link(shade(tree, total), tree.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"])
    return material


def add_object(name: str, data: bpy.types.ID, location: tuple, rotation: tuple = (0, 0, 0)) -> bpy.types.Object:
    """A new object of the scene; the rotation is in radians."""
    result = bpy.data.objects.new(name, data)
    result.location, result.rotation_euler = location, rotation
    bpy.context.scene.collection.objects.link(result)
    return result


def add_mesh(name: str, corners: list[tuple], faces: list[tuple], location: tuple) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], faces)
    return add_object(name, mesh, location)


def build_blender_scene(size: int, step: float, shade: Shade = grey_shade) -> None:
    """Replaces what is in the scene. size: pixels a side; step: of Cycles' marching through the smoke, m."""
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    half = CUBE / 2
    corners = [(x, y, z) for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    cube = add_mesh("Smoke", corners, faces, (0, 0, 0))
    cube.data.materials.append(smoke_material(shade))
    wall = add_mesh("Wall", WALL, [(0, 1, 2, 3)], (0, 0, WALL_HEIGHT))
    wall.visible_camera = False
    for kind, settings, location, rotation in LAMPS:
        lamp = bpy.data.lights.new(kind, kind)
        lamp.energy, lamp.color = settings["power"], settings["color"]
        if kind == "POINT":
            lamp.shadow_soft_size = 0.0
        else:
            lamp.size = settings["size"]
        add_object(kind, lamp, location, rotation)
    view = bpy.data.cameras.new("Camera")
    view.lens = LENS
    scene = bpy.context.scene
    scene.camera = add_object("Camera", view, CAMERA, (math.pi / 2, 0, 0))
    scene.world = None
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x = render.resolution_y = size
    render.resolution_percentage = 100
    render.film_transparent = True
    cycles.pixel_filter_type, cycles.filter_width = "GAUSSIAN", 0.01  # rays through the pixels' centres
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.volume_bounces = 0
    cycles.volume_step_rate = step / (CUBE / 10)  # of a tenth of the object's size
    cycles.volume_max_steps = 4096
    if hasattr(cycles, "volume_biased"):
        cycles.volume_biased = True  # marches with that step, as all did before Blender 5.0: much faster here
    cycles.device = "CPU"


def render_cycles(samples: int, seed: int) -> np.ndarray:
    """(height, width, 4) float64, premultiplied, first row at the bottom."""
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed = samples, seed
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "cycles.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        image.alpha_mode = "CHANNEL_PACKED"  # as it was written
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    return pixels.reshape(scene.render.resolution_y, scene.render.resolution_x, 4).astype(float)


def placed(location: tuple) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = location
    return matrix


def render_reference(size: int, **look: object) -> np.ndarray:
    """The same by the reference: (size, size, 4). look: other than grey_shade's, as of core.Scene.add_particles."""
    with core.Context() as context:
        scene = core.Scene(context)
        particles = {"radius": 2 * GAUSSIANS[:, 3], "density": GAUSSIANS[:, 4], "albedo": ALBEDO, "anisotropy": ANISOTROPY}
        scene.add_particles(GAUSSIANS[:, :3], **particles | look)
        scene.add_mesh(WALL, [(0, 1, 2), (0, 2, 3)], matrix=placed((0, 0, WALL_HEIGHT)), visible_to_camera=False)
        for kind, settings, location, _rotation in LAMPS:
            scene.add_light(kind, matrix=placed(location), cycles=bpy.app.version, **settings)
        view = placed(CAMERA)
        view[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
        camera = core.Camera(matrix=view, lens=LENS, width=size, height=size)
        return core.render_reference(scene, camera, tolerance=1e-3)["Combined"]


def blocks(picture: np.ndarray, side: int) -> np.ndarray:
    """Means of squares of side x side pixels."""
    *rest, height, width, channels = picture.shape
    shape = (*rest, height // side, side, width // side, side, channels)
    return picture.reshape(shape).mean(axis=(-4, -2))


def compare(renders: np.ndarray, reference: np.ndarray) -> dict[str, float | list[float]]:
    """Statistics of the difference. renders: (n, height, width, 4) by Cycles with different seeds.

    mean_ratio: RGBA, of Cycles' mean to the reference's; mean_error: standard error of it.
    z_pixels, z_blocks: RMS of the difference in standard errors, for pixels and for squares of 8 x 8 of them: 1 for
    noise alone; anything systematic shows in the squares.
    """
    count = len(renders)
    means = renders.mean(axis=(1, 2))
    ratio = means.mean(axis=0) / reference.mean(axis=(0, 1))
    error = means.std(axis=0, ddof=1) / math.sqrt(count) / reference.mean(axis=(0, 1))
    found: dict[str, float | list[float]] = {"mean_ratio": ratio.tolist(), "mean_error": error.tolist()}
    spread = math.sqrt((count - 3) / (count - 1))  # of Student's t
    for name, side in (("z_pixels", 1), ("z_blocks", 8)):
        parts, expected = blocks(renders, side)[..., :3], blocks(reference, side)[..., :3]
        lit = expected > 0.02 * expected.max()
        errors = parts.std(axis=0, ddof=1)[lit] / math.sqrt(count)
        found[name] = float(np.sqrt((((parts.mean(axis=0) - expected)[lit] / errors) ** 2).mean()) * spread)
    found["noise"] = float(np.sqrt((renders.var(axis=0, ddof=1)[..., :3] / count).mean() / (reference[..., :3] ** 2).mean()))
    found["rms"] = float(np.sqrt(((renders.mean(axis=0) - reference)[..., :3] ** 2).mean() / (reference[..., :3] ** 2).mean()))
    return found


def write_strip(path: Path, cycles: np.ndarray, reference: np.ndarray, scale: int = 4) -> None:
    """Both pictures, and 10 times their difference around grey: of pixels and of squares of 8 x 8 pixels."""
    white = reference[..., :3].max()
    difference = (cycles - reference)[..., :3] * 10 / white + 0.18
    squares = blocks(difference, 8).repeat(8, axis=0).repeat(8, axis=1)
    views = [cycles[..., :3] / white, reference[..., :3] / white, difference, squares]
    strip = np.clip(np.concatenate(views, axis=1), 0, 1).repeat(scale, axis=0).repeat(scale, axis=1)
    encoded = np.where(strip <= 0.0031308, 12.92 * strip, 1.055 * strip ** (1 / 2.4) - 0.055)
    height, width = strip.shape[:2]
    image = bpy.data.images.new("strip", width, height)
    image.pixels.foreach_set(np.dstack([encoded, np.ones((height, width))]).astype(np.float32).ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()


def main(folder: Path) -> None:
    size, samples, runs = 64, 64, 16
    folder.mkdir(parents=True, exist_ok=True)
    build_blender_scene(size, step=0.05)
    # seeds far from each other: neighbouring ones share noise
    renders = np.stack([render_cycles(samples, 1001 * run + 7) for run in range(runs)])
    reference = render_reference(size)
    write_strip(folder / "cycles_and_reference.png", renders.mean(axis=0), reference)
    print(json.dumps({"blender": bpy.app.version_string, "samples": samples * runs, **compare(renders, reference)}))


if __name__ == "__main__":
    main(Path(sys.argv[sys.argv.index("--") + 1]))
