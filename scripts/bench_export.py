# SPDX-License-Identifier: GPL-3.0-or-later
"""From Blender to the C scene: `./run bench export [--particles N] [--blender 3.4] [--repeats N]`.

Prints a JSON line for points made by geometry nodes and one for a particle system, each with all attributes that the
add-on exports: medians over the repeats in seconds, `read_s` copying out of Blender, `add_s` fum_scene_add_particles,
`convert_s` the rest of `export_s`; `fingerprint_s`, which only renders with persistent data need, is not part of it.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
INSIDE = ROOT / "tests" / "addon" / "inside"
sys.path[:0] = [str(INSIDE), str(INSIDE.parent), str(ROOT / "blender_addon")]


class Stopwatch:
    """Adds up the time spent in functions."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def around(self, function: Callable, counts: Callable[..., bool] = lambda *_arguments: True) -> Callable:
        def timed(*arguments: object, **keywords: object) -> object:
            start = time.perf_counter()
            result = function(*arguments, **keywords)
            if counts(*arguments):
                self.seconds += time.perf_counter() - start
            return result

        return timed


def make_points(count: int) -> None:
    import numpy as np
    import scenes

    random = np.random.default_rng(1)
    positions = random.normal(0, 1, (count, 3)).astype(np.float32)
    attributes = {
        "velocity": ("FLOAT_VECTOR", positions),
        "density": ("FLOAT", random.uniform(0.5, 1.5, count)),
        "tint": ("FLOAT_COLOR", random.uniform(0.2, 0.9, (count, 4))),
        "id": ("INT", np.arange(count)),
    }
    owner = scenes.points_by_nodes("Points", positions.tolist(), attributes=attributes)
    owner.location, owner.rotation_euler.z = (1, 2, 3), 0.5
    look = scenes.material("Smoke", Color_Attribute="tint", Emission_Strength=0.1)
    scenes.set_point_material(owner, look)


def make_system(count: int) -> None:
    import scenes

    scenes.emitter(count=count).data.materials.append(scenes.material("Smoke", Density=8.0))


def measure(particles: int, repeats: int) -> None:
    """Inside Blender: prints the lines."""
    import addon_utils
    import bpy

    addon_utils.enable("fumarole")
    import scenes
    from fumarole import core
    from fumarole.export import particles as systems
    from fumarole.export import points
    from fumarole.export.scene import build, export_scene, fingerprint

    reading, adding = Stopwatch(), Stopwatch()
    points.read_attribute = reading.around(points.read_attribute)
    systems._read = reading.around(systems._read)
    is_add = lambda _context, function, *_arguments: function == "fum_scene_add_particles"  # noqa: E731
    core.Context.call = adding.around(core.Context.call, is_add)

    for source, make in (("points", make_points), ("particle system", make_system)):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        make(particles)
        rows: list[dict[str, float]] = []

        def look(depsgraph: bpy.types.Depsgraph, _exported: object) -> None:
            for _repeat in range(repeats):
                reading.seconds = adding.seconds = 0.0
                start = time.perf_counter()
                with core.Context() as context:
                    scene = export_scene(depsgraph)
                    build(scene, context)
                    export_s = time.perf_counter() - start
                    row = {"export_s": export_s, "read_s": reading.seconds, "add_s": adding.seconds}
                    row["convert_s"] = export_s - reading.seconds - adding.seconds
                    start = time.perf_counter()
                    fingerprint(scene)
                    row["fingerprint_s"] = time.perf_counter() - start
                rows.append(row)

        scenes.export_layers(look)
        medians = {key: round(statistics.median(row[key] for row in rows), 4) for key in rows[0]}
        print(json.dumps({"source": source, "particles": particles, "blender": bpy.app.version_string, **medians}))


def main() -> int:
    parser = argparse.ArgumentParser(prog="./run bench export", description="From Blender to the C scene.")
    parser.add_argument("--particles", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--blender", default="3.4", help="3.4, or a version that ./run test all has installed")
    arguments = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else None)
    if "--" in sys.argv:
        measure(arguments.particles, arguments.repeats)
        return 0
    from blenders import Blender, run

    options = [f"--particles={arguments.particles}", f"--repeats={arguments.repeats}"]
    with tempfile.TemporaryDirectory(prefix="fumarole-") as folder:
        done = run(Blender(arguments.blender).script_command(Path(__file__), *options), Path(folder), 600)
    lines = [line for line in done.output.splitlines() if line.startswith('{"source"')]
    print("\n".join(lines))
    if done.code != 0 or len(lines) != 2:
        print(done.output, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    code = main()
    # bpy 4.5 may deadlock in its exit handlers.
    if "bpy" in sys.modules:
        import os

        sys.stdout.flush()
        os._exit(code)
    sys.exit(code)
