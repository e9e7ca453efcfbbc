# SPDX-License-Identifier: GPL-3.0-or-later
"""The mirrors of the header, and what the library exports and calls."""

from __future__ import annotations

import ctypes
import re
import subprocess
import sys
from pathlib import Path

import abi
import pytest

from fumarole import core
from fumarole.core import _abi, _library

ROOT = Path(__file__).resolve().parent.parent.parent


def symbols(option: str) -> set[str]:
    path = next(path for path in _library.candidates() if path.is_file())
    listing = subprocess.run(["nm", "-D", option, str(path)], capture_output=True, text=True, check=True).stdout
    return {line.split()[-1].split("@")[0] for line in listing.splitlines()}


def test_mirrors_are_current() -> None:
    done = subprocess.run([sys.executable, str(ROOT / "scripts/abi.py"), "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_public_name_of_the_header_is_mirrored() -> None:
    text = abi.remove_comments(abi.HEADER.read_text(encoding="utf-8"))
    functions = set(re.findall(r"FUM_API [\w* ]*?(fum_\w+)\(", text))
    assert functions == set(_abi.FUNCTIONS)
    structs = set(re.findall(r"typedef struct (fum_\w+) \{", text))
    assert structs == {struct.__name__ for struct in _abi.STRUCTS}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("\n\nunion { int x; } y;", "line 3: declaration not understood"),
        ("#pragma pack(1)", "line 1: directive not understood: #pragma pack(1)"),
        ("typedef struct fum_a { long x; } fum_a;", "line 1: type not understood: long x"),
        ("typedef struct fum_a { int32_t x : 3; } fum_a;", "line 1: type not understood: int32_t x : 3"),
        ("typedef struct fum_a { float *x, *y; } fum_a;", "line 1: several pointers"),
        ("enum { FUM_A = 1 << 2 };", "line 1: enumerator without a plain number: FUM_A = 1 << 2"),
        ("enum { FUM_A };", "line 1: enumerator without a plain number"),
        ("FUM_API int32_t fum_f(fum_unknown *x);", "line 1: type not understood: fum_unknown"),
        ("FUM_API int32_t fum_f(int32_t x)", "line 1: text without an end"),
    ],
)
def test_generator_refuses_what_it_does_not_understand(text: str, message: str) -> None:
    with pytest.raises(abi.HeaderError, match=re.escape(message)):
        abi.parse_header(text)


def test_generator_lays_structs_out_as_the_compiler(tmp_path: Path) -> None:
    """A struct with every kind of field, compiled and mirrored."""
    header = """
    typedef struct fum_inner fum_inner;
    typedef int32_t (*fum_back)(void *user, float x);
    typedef struct fum_all {
      int32_t a; double b, c[3]; const char *d; char e[5]; uint64_t f; float *g; fum_back h; size_t i; fum_inner *j;
    } fum_all;
    """
    parsed = abi.parse_header(header)
    mirror: dict[str, object] = {}
    exec(abi.python_mirror(parsed), mirror)  # noqa: S102
    program = abi.c_table(parsed).replace('#include "fumarole.h"', "#include <stddef.h>\n#include <stdint.h>\n" + header)
    declaration = "typedef struct { const char *s, *f; uint32_t o, z; } fum_abi_field;\n"
    program = program.replace("/* clang-format off */", declaration, 1)
    program += '#include <stdio.h>\nint main(void) { for (unsigned i = 0; i < sizeof abi_fields / sizeof *abi_fields; i++)'
    program += ' printf("%s %u %u\\n", abi_fields[i].f, abi_fields[i].o, abi_fields[i].z); }\n'
    (tmp_path / "all.c").write_text(program)
    subprocess.run(["gcc", "-o", tmp_path / "all", tmp_path / "all.c"], check=True)
    listed = subprocess.run([tmp_path / "all"], capture_output=True, text=True, check=True).stdout.splitlines()
    struct = mirror["fum_all"]
    expected = [f" 0 {ctypes.sizeof(struct)}"]
    expected += [f"{n} {getattr(struct, n).offset} {getattr(struct, n).size}" for n, *_ in struct._fields_]
    assert listed == expected


def test_mismatch_is_an_error_that_names_the_field(monkeypatch: pytest.MonkeyPatch) -> None:
    fields = [(name, kind) for name, kind in _abi.fum_settings._fields_ if name != "tolerance"]
    wrong = type("fum_settings", (ctypes.Structure,), {"_fields_": fields})
    structs = tuple(wrong if struct is _abi.fum_settings else struct for struct in _abi.STRUCTS)
    monkeypatch.setattr(_abi, "STRUCTS", structs)
    path = next(path for path in _library.candidates() if path.is_file())
    sizes = rf"\(0, {ctypes.sizeof(_abi.fum_settings)}\).*\(0, {ctypes.sizeof(wrong)}\)"
    with pytest.raises(core.FumaroleError, match=f"does not belong .* fum_settings has .*{sizes}") as caught:
        _library.open_library(path)
    assert caught.value.code == core.ErrorCode.LIBRARY


def test_missing_function_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(_abi.FUNCTIONS, "fum_of_tomorrow", (None, []))
    path = next(path for path in _library.candidates() if path.is_file())
    with pytest.raises(core.FumaroleError, match="has no function fum_of_tomorrow"):
        _library.open_library(path)


def test_missing_or_broken_file_is_an_error_that_names_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    _library.library()
    broken = tmp_path / "libfumarole.so"
    monkeypatch.setenv("FUMAROLE_LIBRARY", str(broken))
    with pytest.raises(core.FumaroleError, match=f"was not found at {broken}"):
        _library.library.__wrapped__()
    broken.write_text("no library")
    with pytest.raises(core.FumaroleError, match=f"{broken} could not be loaded: .*"):
        _library.library.__wrapped__()


def test_only_public_symbols_are_exported() -> None:
    assert symbols("--defined-only") == set(_abi.FUNCTIONS)


def test_library_does_not_print_or_exit() -> None:
    forbidden = {"printf", "puts", "putchar", "perror", "exit", "_exit", "abort", "__assert_fail", "stdout", "stderr"}
    if "__asan_init" in symbols("--undefined-only"):
        pytest.skip("the sanitizers print and exit")
    found = symbols("--undefined-only") & (forbidden | {"__printf_chk"})
    assert not found


def test_library_frees_no_memory_that_libc_allocated() -> None:
    """With RTLD_DEEPBIND the library's free() is libc's, while libc itself calls the host's malloc (jemalloc in
    Debian's Blender): memory that libc allocates for the caller must not be freed by the library."""
    returning = {"strdup", "__strdup", "strndup", "__strndup", "asprintf", "vasprintf", "__asprintf_chk", "getline"}
    returning |= {"__vasprintf_chk", "getdelim", "__getdelim", "open_memstream", "realpath", "getcwd", "scandir"}
    assert not symbols("--undefined-only") & returning


def test_importing_the_core_imports_no_bpy_and_loads_no_library() -> None:
    program = "import sys, fumarole.core; from fumarole.core import _library; "
    program += "assert 'bpy' not in sys.modules; assert _library.library.cache_info().currsize == 0"
    environment = {"PYTHONPATH": str(ROOT / "blender_addon"), "PATH": "/usr/bin:/bin"}
    subprocess.run([sys.executable, "-c", program], env=environment, check=True)
