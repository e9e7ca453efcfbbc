# SPDX-License-Identifier: GPL-3.0-or-later
"""The library inside hosts that hold other versions of the libraries it uses, or another malloc."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exr_reader import read_exr

ROOT = Path(__file__).resolve().parent.parent.parent
BPY_LIBRARIES = ROOT / "build/blenders/5.0/lib/python3.11/site-packages/bpy/lib"
JEMALLOC = Path("/usr/lib/x86_64-linux-gnu/libjemalloc.so.2")

WORK = """
import sys
import numpy as np
from fumarole import core
context = core.Context()
for index in range(100):
    scene = core.Scene(context)
    scene.add_particles([(0, 0, float("nan")), (0, 0, 0)], name=f"puff number {index} with a name")
    try:
        scene.add_light("POINT", power=-1.0, name="x" * 300)
    except core.FumaroleError:
        pass
assert len(context.warnings) == 100
scene = core.Scene(context)
scene.add_particles([(0, 0, 0)], radius=1.0, density=2.0)
scene.add_mesh([(-1, -1, 2), (1, -1, 2), (1, 1, 2), (-1, 1, 2)], [(0, 1, 2), (0, 2, 3)])
scene.add_light("POINT", matrix=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]])
assert core.transmittance(scene, [(0, 0, 1), (5, 0, 3)]).tolist() == [0.0, 1.0], "the mesh casts no shadow"
assert core.render(scene, core.Camera(width=8, height=8))["Combined"].any()
core.write_exr(sys.argv[1], {"": np.random.default_rng(1).normal(size=(40, 30, 4))})
context.close()
"""


PRELOAD = f"""
import ctypes
for name in ("libembree4.so.4", "libOpenEXRCore.so.32"):
    ctypes.CDLL({str(BPY_LIBRARIES)!r} + "/" + name, mode=ctypes.RTLD_GLOBAL)
"""


def run_work(path: Path, before: str = "", preload: str = "") -> subprocess.CompletedProcess[str]:
    """Runs WORK in a Python of its own, after the statements `before` and with the library `preload` in front."""
    preloads = " ".join(filter(None, (os.environ.get("LD_PRELOAD"), preload)))
    environment = os.environ | {"PYTHONPATH": str(ROOT / "blender_addon"), "LD_PRELOAD": preloads}
    command = [sys.executable, "-c", before + WORK, str(path)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)


def check_work(done: subprocess.CompletedProcess[str], path: Path) -> None:
    """Checks that WORK succeeded and that the file it wrote is right."""
    assert done.returncode == 0, done.stderr
    channels = read_exr(path)
    picture = np.random.default_rng(1).normal(size=(40, 30, 4)).astype(np.float32)
    for index, name in enumerate("RGBA"):
        np.testing.assert_array_equal(channels[name], picture[..., index])


def skip_without_other_libraries() -> None:
    if not (BPY_LIBRARIES / "libembree4.so.4").exists():
        pytest.skip("build/blenders/5.0 is not there; ./run test all makes it")
    if "asan" in os.environ.get("LD_PRELOAD", ""):
        pytest.skip("AddressSanitizer refuses RTLD_DEEPBIND")


def test_plain_host(tmp_path: Path) -> None:
    check_work(run_work(tmp_path / "a.exr"), tmp_path / "a.exr")


def test_host_with_embree_4_and_another_openexr(tmp_path: Path) -> None:
    skip_without_other_libraries()
    check_work(run_work(tmp_path / "a.exr", before=PRELOAD), tmp_path / "a.exr")


def test_wrong_embree_is_refused(tmp_path: Path) -> None:
    """The same host without RTLD_DEEPBIND: the library reaches Embree 4 and must say so."""
    skip_without_other_libraries()
    shallow = "import os\nfrom fumarole.core import _library\n"
    shallow += "_library.load_mode = lambda: os.RTLD_LOCAL | os.RTLD_NOW\n"
    done = run_work(tmp_path / "a.exr", before=PRELOAD + shallow)
    assert done.returncode == 1
    assert "FumaroleError" in done.stderr and "Embree" in done.stderr.splitlines()[-1]


def test_host_with_jemalloc(tmp_path: Path) -> None:
    """Debian's Blender has jemalloc in place of libc's malloc."""
    if not JEMALLOC.exists():
        pytest.skip(f"{JEMALLOC} is not installed")
    if "asan" in os.environ.get("LD_PRELOAD", ""):
        pytest.skip("AddressSanitizer brings its own malloc")
    check_work(run_work(tmp_path / "a.exr", preload=str(JEMALLOC)), tmp_path / "a.exr")


@pytest.mark.parametrize(("asked", "heard"), [(None, "PASSIVE"), ("active", "ACTIVE")])
def test_threads_wait_without_spinning_unless_asked(asked: str | None, heard: str) -> None:
    program = "import os; from fumarole.core import _library; _library.library(); print(os.environ.get('OMP_WAIT_POLICY'))"
    environment = dict(os.environ, PYTHONPATH=str(ROOT / "blender_addon"), OMP_DISPLAY_ENV="true")
    environment.pop("OMP_WAIT_POLICY", None)
    if asked is not None:
        environment["OMP_WAIT_POLICY"] = asked
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert f"OMP_WAIT_POLICY = '{heard}'" in done.stderr
    assert done.stdout.strip() == str(asked), "the host's environment is as it was"
