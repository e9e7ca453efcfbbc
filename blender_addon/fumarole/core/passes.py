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

    kind: "COLOR", "VALUE" or "VECTOR". description: a sentence with units.
    """

    name: str
    channels: str
    kind: str
    description: str
    number: int


@functools.cache
def passes() -> Mapping[str, Pass]:
    """All passes by name, in the order of the table. Raises FumaroleError when the library cannot be loaded."""
    table = {}
    info = _abi.fum_pass_info()
    while library().fum_pass_get(len(table), ctypes.byref(info)) == _abi.FUM_OK:
        name = info.name.decode()
        number = getattr(info, "pass")
        table[name] = Pass(name, info.channels.decode(), info.kind.decode(), info.description.decode(), number)
    return table
