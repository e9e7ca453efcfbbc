# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes build/package/fumarole-VERSION.zip, which installs in Blender 3.4 as an add-on and in 4.2 and later as an extension.

The zip holds the add-on, libfumarole.so of the release build, and the shared libraries that Blender's users may not
have, with their licences. They find each other by the rpath $ORIGIN. The same input gives the same zip.

Left to the system are glibc, libgcc_s, libstdc++ and libz: whoever has a glibc as new as the one this was built with
has them as new, and a copy loaded first could be older than the one the system's own graphics driver needs.
"""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import abi

ROOT = Path(__file__).resolve().parent.parent
ADDON = ROOT / "blender_addon" / "fumarole"
LIBRARY = ROOT / "build" / "release" / "libfumarole.so"
PACKAGE = ROOT / "build" / "package"

SYSTEM_LIBRARIES = re.compile(
    r"(linux-vdso|ld-linux-x86-64|ld-linux-aarch64|libc|libm|libdl|libpthread|librt|libgcc_s|libstdc\+\+|libz)\.so(\.\d+)*"
)
ZIP_TIME = (1980, 1, 1, 0, 0, 0)


class PackageError(Exception):
    """The package cannot be made; the text says why."""


def output_of(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise PackageError(f"{' '.join(command)} failed: {done.stderr.strip()}")
    return done.stdout


def header_version() -> str:
    constants = abi.parse_header(abi.HEADER.read_text(encoding="utf-8")).constants
    return ".".join(str(constants[f"FUM_VERSION_{part}"]) for part in ("MAJOR", "MINOR", "PATCH"))


def addon_versions() -> dict[str, str]:
    """The versions that the add-on's two descriptions give."""
    manifest = tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))
    module = ast.parse((ADDON / "__init__.py").read_text(encoding="utf-8"))
    infos = [
        ast.literal_eval(node.value)
        for node in module.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", None) == "bl_info"
    ]
    if len(infos) != 1:
        raise PackageError("blender_addon/fumarole/__init__.py does not hold one bl_info")
    return {"blender_manifest.toml": manifest["version"], "bl_info": ".".join(map(str, infos[0]["version"]))}


def checked_version() -> str:
    """The version, when the header, the manifest and bl_info agree on it."""
    version = header_version()
    for place, other in addon_versions().items():
        if other != version:
            raise PackageError(f"fumarole.h has version {version}, {place} has {other}")
    return version


def needed_libraries(library: Path) -> dict[str, Path]:
    """Shared libraries by name that `library` needs, directly or not, and that the system cannot be trusted to have."""
    needed = {}
    for line in output_of("ldd", str(library)).splitlines():
        name, _, rest = line.strip().partition(" => ")
        name = Path(name.split(" ")[0]).name
        if SYSTEM_LIBRARIES.fullmatch(name):
            continue
        path = rest.split(" (")[0]
        if not path.startswith("/"):
            raise PackageError(f"{library}: {name} was not found")
        needed[name] = Path(path)
    return needed


def copy_license(library: Path, folder: Path) -> None:
    """Copies the licence of the Debian package that `library` comes from."""
    owner = output_of("dpkg-query", "-S", str(library.resolve())).split(":")[0]
    folder.mkdir(exist_ok=True)
    shutil.copyfile(f"/usr/share/doc/{owner}/copyright", folder / f"{owner}.txt")


def copy_libraries(folder: Path) -> None:
    """Copies the library and what it needs, stripped, each looking for the others beside itself."""
    folder.mkdir()
    needed = needed_libraries(LIBRARY)
    for name, path in {LIBRARY.name: LIBRARY, **needed}.items():
        shutil.copyfile(path, folder / name)
        output_of("strip", "--strip-unneeded", str(folder / name))
        output_of("patchelf", "--set-rpath", "$ORIGIN", str(folder / name))
    for path in needed.values():
        copy_license(path, folder / "licenses")


def copy_addon(folder: Path) -> None:
    shutil.copytree(ADDON, folder, ignore=shutil.ignore_patterns("__pycache__", "lib"))
    shutil.copyfile(ROOT / "LICENSE", folder / "LICENSE")


def write_zip(folder: Path, path: Path) -> None:
    """Packs `folder`, its own name on top; in one step, so that a failure leaves no half a zip."""
    partial = path.with_suffix(".part")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(file for file in folder.rglob("*") if file.is_file()):
            info = zipfile.ZipInfo(str(file.relative_to(folder.parent)), ZIP_TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, file.read_bytes())
    partial.replace(path)


def make_package() -> Path:
    """Makes the zip of the release build and gives its path. Raises PackageError."""
    version = checked_version()
    if not LIBRARY.exists():
        raise PackageError(f"{LIBRARY} is missing: cmake --preset release && cmake --build --preset release")
    staging = PACKAGE / "fumarole"
    shutil.rmtree(staging, ignore_errors=True)
    PACKAGE.mkdir(parents=True, exist_ok=True)
    copy_addon(staging)
    copy_libraries(staging / "lib")
    path = PACKAGE / f"fumarole-{version}.zip"
    write_zip(staging, path)
    return path


def main() -> int:
    try:
        print(make_package())
    except PackageError as error:
        print(f"package: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
