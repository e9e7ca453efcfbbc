# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares the speed of Fumarole with that of Cycles, on the same particles: `./run bench cycles`.

    blender -b --factory-startup --python scripts/compare_speed.py -- [--particles N] [--samples S ...] [--converged S]
        [--size PIXELS] [--threads T] [--folder FOLDER]

Cycles renders a plume through Points to Volume, without volume bounces, at several numbers of samples and twice with many
more: the mean of those two is its converged picture. Fumarole renders the same points under the same light. Both render
through Blender's render operator and write the picture, so times hold everything. Each is judged by its own truth, Cycles
by its converged picture, Fumarole by its reference at some of the pixels; how far both truths are apart is said as well.

Writes FOLDER/charts/cycles.csv and FOLDER/pictures/cycles_and_fumarole.png, fills the tables in FOLDER/PERFORMANCE.md and
prints them. FOLDER is docs unless said.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "blender_addon")]
os.environ.setdefault("FUMAROLE_PICTURES", os.devnull)

import blender_checkout  # noqa: E402, F401  enables the add-on
import compare_cycles  # noqa: E402
import doc_tables  # noqa: E402
import paper_pictures  # noqa: E402
import speed_match  # noqa: E402
from fumarole import core  # noqa: E402

ALBEDO = (0.8, 0.8, 0.8)
CAMERA, LENS = (0.0, -8.0, 1.5), 72.0
LAMP, POWER = (5.0, -2.0, 4.0), 4000.0
TOLERANCES = (0.1, 0.01)  # of Fumarole; the last one is its default
EVERY = 8  # pixels of the picture along a side for one of Fumarole's reference
COLUMNS = ("engine", "samples", "tolerance", "threads", "seconds", "processor_s", "error")

Row = dict[str, object]


def smoke_material(name: str, density: float) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    volume, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    volume.inputs["Color"].default_value = (*ALBEDO, 1.0)
    volume.inputs["Density"].default_value = density
    tree.links.new(volume.outputs[0], output.inputs["Volume"])
    return material


def add_points(name: str, positions: np.ndarray, radius: float, look: bpy.types.Material, voxel: float = 0.0) -> bpy.types.Object:
    """An object of which geometry nodes make points and, of these, a volume where `voxel` is above 0."""
    owner = compare_cycles.add_mesh(name, positions.tolist(), [], (0, 0, 0))
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.inputs.new("NodeSocketGeometry", "Geometry")
    tree.outputs.new("NodeSocketGeometry", "Geometry")
    points, paint = tree.nodes.new("GeometryNodeMeshToPoints"), tree.nodes.new("GeometryNodeSetMaterial")
    points.inputs["Radius"].default_value = radius
    paint.inputs["Material"].default_value = look
    chain = [tree.nodes.new("NodeGroupInput"), points]
    if voxel > 0.0:
        volume = tree.nodes.new("GeometryNodePointsToVolume")
        volume.resolution_mode = "VOXEL_SIZE"
        volume.inputs["Voxel Size"].default_value = voxel
        volume.inputs["Radius"].default_value = radius
        volume.inputs["Density"].default_value = 1.0
        chain.append(volume)
    chain += [paint, tree.nodes.new("NodeGroupOutput")]
    for before, after in zip(chain, chain[1:], strict=False):
        tree.links.new(before.outputs[0], after.inputs[0])
    owner.modifiers.new(name, "NODES").node_group = tree
    return owner


def build_scene(smoke: speed_match.Smoke, spheres: speed_match.Spheres, size: int, threads: int) -> None:
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    add_points("FUMAROLE", smoke.positions, 2.0 * smoke.sigma, smoke_material("Gaussians", smoke.density))
    add_points("CYCLES", smoke.positions, spheres.radius, smoke_material("Spheres", spheres.density), spheres.voxel)
    lamp = bpy.data.lights.new("Lamp", "POINT")
    lamp.energy, lamp.shadow_soft_size = POWER, 0.0
    compare_cycles.add_object("Lamp", lamp, LAMP)
    view = bpy.data.cameras.new("Camera")
    view.lens = LENS
    scene = bpy.context.scene
    scene.camera = compare_cycles.add_object("Camera", view, CAMERA, (math.pi / 2, 0, 0))
    scene.world = None
    render, cycles = scene.render, scene.cycles
    render.resolution_x = render.resolution_y = size
    render.resolution_percentage = 100
    render.film_transparent = True
    render.threads_mode, render.threads = "FIXED", threads
    cycles.pixel_filter_type, cycles.filter_width = "GAUSSIAN", 0.01  # rays through the pixels' centres
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.volume_bounces = 0
    cycles.device = "CPU"


def processor_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def render(engine: str, samples: int = 1, seed: int = 0) -> tuple[np.ndarray, Row]:
    """(height, width, 4), first row at the bottom, and what it took: on the clock, and of all threads."""
    scene = bpy.context.scene
    scene.render.engine = engine
    for name in ("FUMAROLE", "CYCLES"):
        bpy.data.objects[name].hide_render = name != engine
    start, work = time.monotonic(), processor_seconds()
    picture = compare_cycles.render_cycles(samples, seed)
    return picture, {"seconds": time.monotonic() - start, "processor_s": processor_seconds() - work}


def reference(smoke: speed_match.Smoke, size: int) -> np.ndarray:
    """What Fumarole aims at, at the centre of every EVERYth pixel of every EVERYth row."""
    with core.Context() as context:
        scene = core.Scene(context)
        scene.add_particles(smoke.positions, radius=2.0 * smoke.sigma, density=smoke.density, albedo=ALBEDO)
        scene.add_light("POINT", matrix=compare_cycles.placed(LAMP), power=POWER, cycles=bpy.app.version)
        view = compare_cycles.placed(CAMERA)
        view[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
        left, right, bottom, top = core.Camera(matrix=view, lens=LENS, width=size, height=size).window
        count = size // EVERY
        shift_x, shift_y = ((b - a) / size * (EVERY // 2 + 0.5 - EVERY / 2) for a, b in ((left, right), (bottom, top)))
        window = (left + shift_x, right + shift_x, bottom + shift_y, top + shift_y)
        sparse = core.Camera.from_window(view, window, count, count)
        return core.render_reference(scene, sparse, tolerance=1e-3)["Combined"]


def relative_rms(found: np.ndarray, expected: np.ndarray) -> float:
    difference, rgb = (found - expected)[..., :3], expected[..., :3]
    return float(np.sqrt(np.square(difference).sum() / np.square(rgb).sum()))


def measure_cycles(counts: Sequence[int], converged: int) -> tuple[list[Row], dict[int, np.ndarray], np.ndarray]:
    """The rows, the pictures by their samples, and the converged one.

    Two independent pictures of the same number of samples differ by sqrt(2) times their error. Their mean still has
    error / sqrt(2); that is taken off the difference to the others.
    """
    first, most = render("CYCLES", converged, seed=99)
    second, _ = render("CYCLES", converged, seed=7777)
    truth = 0.5 * (first + second)
    last = relative_rms(first, second) / math.sqrt(2.0)
    rows, pictures = [], {}
    for samples in counts:
        pictures[samples], took = render("CYCLES", samples, seed=1001 * samples)
        error = math.sqrt(max(0.0, relative_rms(pictures[samples], truth) ** 2 - 0.5 * last**2))
        rows.append({"engine": "Cycles", "samples": samples, **took, "error": error})
    return [*rows, {"engine": "Cycles", "samples": converged, **most, "error": last}], pictures, truth


def measure_fumarole(smoke: speed_match.Smoke, size: int) -> tuple[list[Row], np.ndarray]:
    """A row for each tolerance, with the median time of five, and the last picture."""
    truth, settings = reference(smoke, size), bpy.context.scene.fumarole
    rows = []
    for tolerance in TOLERANCES:
        settings.tolerance = tolerance
        runs = [render("FUMAROLE") for _ in range(5)]
        picture = runs[0][0]
        error = relative_rms(picture[EVERY // 2 :: EVERY, EVERY // 2 :: EVERY], truth)
        took = sorted((took for _, took in runs), key=lambda took: took["seconds"])[2]
        rows.append({"engine": "Fumarole", "tolerance": tolerance, **took, "error": error})
    return rows, picture


def extrapolate(rows: Sequence[Row], error: float) -> Row:
    """What Cycles would take for this error if it went on to fall as it did over the last rows."""
    before, last = rows[-3:][0], rows[-1]
    rate = math.log(before["error"] / last["error"]) / math.log(last["samples"] / before["samples"])
    more = (last["error"] / error) ** (1.0 / rate)
    grown = {name: last[name] * more for name in ("samples", "seconds", "processor_s")}
    return grown | {"error": error, "rate": rate}


def make_table(cycles: Sequence[Row], ours: Sequence[Row]) -> str:
    further = extrapolate(cycles, ours[-1]["error"])
    named = [(row, "Cycles", f"{row['samples']:,} samples") for row in cycles]
    samples = float(f"{further['samples']:.2g}")
    guess = f"{samples:,.0f} samples, extrapolated: error falls as samples^-{further['rate']:.2f}"
    named.append((further, "Cycles", guess))
    named += [(row, "Fumarole", f"tolerance {100 * row['tolerance']:.2g} %") for row in ours]
    titles = ("engine", "setting", "time (s)", "processor time (s)", "error against its own truth")
    cells = [
        [engine, setting, *(doc_tables.seconds(row[name]) for name in ("seconds", "processor_s")), f"{100 * row['error']:.2g} %"]
        for row, engine, setting in named
    ]
    return doc_tables.markdown(titles, cells)


def match_table(smoke: speed_match.Smoke, spheres: speed_match.Spheres, ours: np.ndarray, truth: np.ndarray) -> str:
    """How well both engines see the same smoke."""
    titles = ("particles", "spheres' radius", "voxel", "densities differ by", "pictures differ by", "mean of Fumarole / of Cycles")
    ratio = ours[..., :3].mean() / truth[..., :3].mean()
    sizes = [f"{value / smoke.sigma:.2f} sigma" for value in (spheres.radius, spheres.voxel)]
    apart = [f"{100 * value:.2g} %" for value in (spheres.left, relative_rms(ours, truth))]
    return doc_tables.markdown(titles, [[f"{len(smoke.positions):,}", *sizes, *apart, f"{ratio:.3f}"]])


def write_pictures(path: Path, pictures: dict[int, np.ndarray], truth: np.ndarray, ours: np.ndarray) -> None:
    """Side by side under one exposure, with the difference to Cycles around grey."""
    white = float(np.quantile(truth[..., :3].max(axis=2)[truth[..., 3] > 0.01], 0.995))
    difference = np.dstack([(ours - truth)[..., :3] + 0.18 * white, np.ones(ours.shape[:2])])
    shown = {f"Cycles, {samples} samples": picture for samples, picture in pictures.items() if samples <= 64}
    shown |= {"Cycles, converged": truth, "Fumarole": ours, "Fumarole - Cycles": difference}
    paper_pictures.write_sheet(path, {title: picture[::-1] for title, picture in shown.items()}, white)


def write_csv(path: Path, rows: Sequence[Row], threads: int) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            short = {name: f"{value:.4g}" if isinstance(value, float) else value for name, value in row.items()}
            writer.writerow(short | {"threads": threads})


def read_options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="./run bench cycles", description="The speed of Fumarole and of Cycles.")
    parser.add_argument("--particles", type=int, default=30_000)
    parser.add_argument("--samples", type=int, nargs="+", default=[4, 16, 64, 256])
    parser.add_argument("--converged", type=int, default=1024, metavar="SAMPLES")
    parser.add_argument("--size", type=int, default=256, help="pixels a side")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--folder", type=Path, default=ROOT / "docs")
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1 :])


def main() -> None:
    options = read_options()
    smoke = speed_match.plume(options.particles)
    spheres = speed_match.fit(smoke)
    build_scene(smoke, spheres, options.size, options.threads)
    for engine in ("CYCLES", "FUMAROLE"):
        render(engine)  # the first one of each loads and compiles
    ours, picture = measure_fumarole(smoke, options.size)
    cycles, pictures, truth = measure_cycles(options.samples, options.converged)
    for name in ("charts", "pictures"):
        (options.folder / name).mkdir(parents=True, exist_ok=True)
    write_csv(options.folder / "charts" / "cycles.csv", [*cycles, *ours], options.threads)
    write_pictures(options.folder / "pictures" / "cycles_and_fumarole.png", pictures, truth, picture)
    document = options.folder / "PERFORMANCE.md"
    tables = {"cycles": make_table(cycles, ours), "cycles_match": match_table(smoke, spheres, picture, truth)}
    for name, table in tables.items():
        print(f"{table}\n")
        if document.exists():
            document.write_text(doc_tables.put(document.read_text(), name, table))


if __name__ == "__main__":
    main()
