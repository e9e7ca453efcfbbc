# SPDX-License-Identifier: GPL-3.0-or-later
"""The pass table, read from the library: the one list of passes."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
from collections.abc import Mapping

from . import _abi
from ._library import library


@dataclasses.dataclass(frozen=True)
class Pass:
    """A render pass: its name, a letter a channel ("RGBA", "Z"), and what it is.

    kind: "COLOR", "VALUE" or "VECTOR". description: a sentence with units. of_light: there is one for every light.
    """

    name: str
    channels: str
    kind: str
    description: str
    number: int
    of_light: bool


@functools.cache
def passes() -> Mapping[str, Pass]:
    """All passes by name, in the order of the table. Raises FumaroleError when the library cannot be loaded."""
    table = {}
    info = _abi.fum_pass_info()
    while library().fum_pass_get(len(table), ctypes.byref(info)) == _abi.FUM_OK:
        name = info.name.decode()
        texts = (text.decode() for text in (info.channels, info.kind, info.description))
        table[name] = Pass(name, *texts, getattr(info, "pass"), bool(info.of_light))
    return table
