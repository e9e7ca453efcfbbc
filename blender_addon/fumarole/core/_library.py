# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds and loads libfumarole.so once, and checks that it is the one the mirror in _abi.py was made for."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
from collections.abc import Iterator
from pathlib import Path

from . import _abi
from .errors import ErrorCode, FumaroleError

FILE_NAME = "libfumarole.so"
ADDON = Path(__file__).resolve().parent.parent


def candidates() -> list[Path]:
    """Where the library may be, best first: FUMAROLE_LIBRARY alone if set, else the package, else a checkout's build."""
    chosen = os.environ.get("FUMAROLE_LIBRARY")
    if chosen:
        return [Path(chosen)]
    return [ADDON / "lib" / FILE_NAME, ADDON.parent.parent / "build" / "release" / FILE_NAME]


def load_mode() -> int:
    """Flags for dlopen.

    RTLD_DEEPBIND makes the library's calls to Embree and OpenEXR end in the versions it was built for, where a host
    that holds others would answer with those: then every mesh shadow vanishes without an error. AddressSanitizer
    refuses the flag.
    """
    mode = os.RTLD_LOCAL | os.RTLD_NOW
    if hasattr(ctypes.CDLL(None), "__asan_init"):
        return mode
    return mode | os.RTLD_DEEPBIND


def check_abi(library: ctypes.CDLL, path: Path) -> None:
    """Compares each struct's size and each field's offset and size with the mirror; FumaroleError if they differ."""
    fields = ctypes.POINTER(_abi.fum_abi_field)()
    count = library.fum_abi_fields(ctypes.byref(fields))
    compiled = {
        (item.struct_name.decode(), item.field_name.decode()): (item.offset, item.size) for item in fields[:count]
    }
    mirrored = {}
    for struct in _abi.STRUCTS:
        mirrored[struct.__name__, ""] = (0, ctypes.sizeof(struct))
        for name, *_ in struct._fields_:
            field = getattr(struct, name)
            mirrored[struct.__name__, name] = (field.offset, field.size)
    for struct_name, field_name in sorted(compiled.keys() | mirrored.keys()):
        key = (struct_name, field_name)
        if compiled.get(key) == mirrored.get(key):
            continue
        name = ".".join(filter(None, key))
        raise FumaroleError(
            ErrorCode.LIBRARY,
            f"{path} does not belong to this version of the Python files: {name} has (offset, size) "
            f"{compiled.get(key, 'nothing')} in the library, {mirrored.get(key, 'nothing')} in Python. "
            "Build or install both together.",
        )


@contextlib.contextmanager
def waiting_passively() -> Iterator[None]:
    """OpenMP reads once, when it is loaded, how its threads wait for each other. By default they spin, which is a gain of
    microseconds on an idle machine and triples the time of a frame on one where something else runs."""
    if "OMP_WAIT_POLICY" in os.environ:
        yield
        return
    os.environ["OMP_WAIT_POLICY"] = "passive"
    try:
        yield
    finally:
        del os.environ["OMP_WAIT_POLICY"]


def open_library(path: Path) -> ctypes.CDLL:
    """Loads the library at `path`, gives every function its signature and checks the structs.

    Raises FumaroleError (LIBRARY) naming the file and what is wrong with it.
    """
    try:
        with waiting_passively():
            library = ctypes.CDLL(str(path), mode=load_mode())
    except OSError as error:
        raise FumaroleError(ErrorCode.LIBRARY, f"{path} could not be loaded: {error}") from None
    for name, (result, parameters) in _abi.FUNCTIONS.items():
        try:
            function = getattr(library, name)
        except AttributeError:
            message = f"{path} has no function {name}: build or install the library and the Python files together"
            raise FumaroleError(ErrorCode.LIBRARY, message) from None
        function.restype, function.argtypes = result, parameters
    check_abi(library, path)
    return library


@functools.cache
def library() -> ctypes.CDLL:
    """The loaded library, found and checked on the first call. Raises FumaroleError (LIBRARY)."""
    paths = candidates()
    for path in paths:
        if path.is_file():
            return open_library(path)
    places = " or ".join(str(path) for path in paths)
    raise FumaroleError(ErrorCode.LIBRARY, f"{FILE_NAME} was not found at {places}")
