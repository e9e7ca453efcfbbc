# SPDX-License-Identifier: GPL-3.0-or-later
"""The zip that users install."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import package
import pytest

ALLOWED = package.SYSTEM_LIBRARIES


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as a user has it, beside nothing else."""
    folder = tmp_path_factory.mktemp("user")
    with zipfile.ZipFile(package.make_package()) as archive:
        archive.extractall(folder)
    return folder / "fumarole"


def run_python(unpacked: Path, program: str, *arguments: str, emulator: Sequence[str] = ()) -> None:
    """Runs a program that knows the package alone; it must end well."""
    environment = {"PYTHONPATH": str(unpacked.parent), "PATH": "/usr/bin:/bin"}
    command = [*emulator, sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def readelf(path: Path) -> str:
    return subprocess.run(["readelf", "-d", path], capture_output=True, text=True, check=True).stdout


def test_top_folder_holds_what_both_kinds_of_installation_need(unpacked: Path) -> None:
    assert [path.name for path in unpacked.parent.iterdir()] == ["fumarole"]
    for name in ("__init__.py", "blender_manifest.toml", "LICENSE", "core/_abi.py", "lib/libfumarole.so"):
        assert (unpacked / name).is_file(), name
    names = [str(path.relative_to(unpacked)) for path in unpacked.rglob("*")]
    assert not [name for name in names if "__pycache__" in name or "test" in name]


def test_every_library_is_inside_or_the_system_s(unpacked: Path) -> None:
    libraries = list((unpacked / "lib").glob("*.so*"))
    inside = {path.name for path in libraries}
    for path in libraries:
        tags = readelf(path)
        for name in re.findall(r"NEEDED.*\[(.*)\]", tags):
            assert name in inside or ALLOWED.fullmatch(name), f"{path.name} needs {name}"
        assert re.findall(r"R(?:UN)?PATH.*\[(.*)\]", tags) == ["$ORIGIN"]


def test_libraries_resolve_inside(unpacked: Path) -> None:
    listing = subprocess.run(
        ["ldd", unpacked / "lib/libfumarole.so"], capture_output=True, text=True, check=True
    ).stdout
    assert "not found" not in listing
    inside = {path.name for path in (unpacked / "lib").glob("*.so*")} - {"libfumarole.so"}
    found = dict(re.findall(r"(\S+) => (\S+)", listing))
    assert inside
    for name in inside:
        assert Path(found[name]).resolve() == (unpacked / "lib" / name).resolve()


def test_no_glibc_newer_than_the_readme_says_is_needed(unpacked: Path) -> None:
    promised = re.search(r"glibc (\d+)\.(\d+) or later", (package.ROOT / "README.md").read_text(encoding="utf-8"))
    for path in (unpacked / "lib").glob("*.so*"):
        symbols = subprocess.run(["nm", "-D", path], capture_output=True, text=True, check=True).stdout
        needed = max((int(major), int(minor)) for major, minor in re.findall(r"@GLIBC_(\d+)\.(\d+)", symbols))
        assert needed <= (int(promised[1]), int(promised[2])), path.name


def test_libraries_are_stripped_and_have_their_licenses(unpacked: Path) -> None:
    for path in (unpacked / "lib").glob("*.so*"):
        sections = subprocess.run(["readelf", "-S", "-W", path], capture_output=True, text=True, check=True).stdout
        assert ".symtab" not in sections and ".debug_info" not in sections, path.name
    texts = {path.stem: path.read_text() for path in (unpacked / "lib/licenses").iterdir()}
    assert any("embree" in name for name in texts) and any("openexr" in name for name in texts)
    assert all("icense" in text for text in texts.values())


def test_package_works_from_where_it_is_unpacked(unpacked: Path) -> None:
    program = """
from pathlib import Path
from fumarole import core
from fumarole.core import _library
assert _library.candidates()[0].is_file()
scene = core.Scene()
scene.add_particles([(0, 0, -5)])
assert core.render(scene, core.Camera(width=8, height=8))["Combined"].any()
lines = Path("/proc/self/maps").read_text().splitlines()
loaded = {line.split()[-1] for line in lines if "/fumarole/lib/" in line}
assert {Path(path).name for path in loaded} >= {"libfumarole.so", "libembree3.so.3"}, loaded
assert all(path.startswith(str(_library.ADDON)) for path in loaded)
"""
    run_python(unpacked, program)


@pytest.mark.skipif(shutil.which("qemu-x86_64") is None, reason="no qemu-x86_64")
def test_package_works_on_any_processor_of_x86_64_v2(unpacked: Path, tmp_path: Path) -> None:
    """Smoke swept by a light past a solid, on this processor and on an emulated Nehalem, which knows no AVX."""
    program = """
import sys
import numpy as np
from fumarole import core
scene = core.Scene()
scene.add_particles(np.random.default_rng(1).normal(size=(12000, 3)) / 2 - (0, 0, 5), radius=0.1, density=3.0)
scene.add_mesh([(-1, -1, -5), (1, -1, -5), (0, 1, -5)], [(0, 1, 2)])
lamp = np.eye(4)
lamp[:3, 3] = 2, -3, 4
scene.add_light("POINT", matrix=lamp)
np.save(sys.argv[1], core.render(scene, core.Camera(width=48, height=48), core.Settings(device="TILES"))["Combined"])
"""
    paths = [tmp_path / "here.npy", tmp_path / "emulated.npy"]
    run_python(unpacked, program, str(paths[0]))
    run_python(unpacked, program, str(paths[1]), emulator=("qemu-x86_64", "-cpu", "Nehalem"))
    here, emulated = (np.load(path) for path in paths)
    assert here[..., :3].max() > 0 and np.allclose(here, emulated, rtol=1e-3, atol=1e-3 * here.max())


def test_same_input_gives_the_same_zip(unpacked: Path) -> None:
    path = package.PACKAGE / f"fumarole-{package.header_version()}.zip"
    first = path.read_bytes()
    assert package.make_package() == path
    assert path.read_bytes() == first


def test_versions_must_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    assert package.checked_version() == package.header_version()
    monkeypatch.setattr(package, "header_version", lambda: "99.0.0")
    with pytest.raises(package.PackageError, match=r"fumarole.h has version 99.0.0, blender_manifest.toml has "):
        package.checked_version()
