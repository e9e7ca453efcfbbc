# SPDX-License-Identifier: GPL-3.0-or-later
"""The pass table, read from the library: the one list of passes."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
from collections.abc import Mapping

from . import _abi
from ._library import library


_PER = {_abi.FUM_PER_PICTURE: "PICTURE", _abi.FUM_PER_LIGHT: "LIGHT", _abi.FUM_PER_RANKS: "RANKS"}


@dataclasses.dataclass(frozen=True)
class Pass:
    """A render pass: its name, a letter a channel ("RGBA", "Z"), and what it is.

    kind: "COLOR", "VALUE" or "VECTOR". description: a sentence with units. per: "PICTURE" where there is one, "LIGHT"
    where there is one for every light, "RANKS" where there is one for every two ranks of Cryptomatte.
    """

    name: str
    channels: str
    kind: str
    description: str
    number: int
    per: str


@functools.cache
def passes() -> Mapping[str, Pass]:
    """All passes by name, in the order of the table. Raises FumaroleError when the library cannot be loaded."""
    table = {}
    info = _abi.fum_pass_info()
    while library().fum_pass_get(len(table), ctypes.byref(info)) == _abi.FUM_OK:
        name = info.name.decode()
        texts = (text.decode() for text in (info.channels, info.kind, info.description))
        table[name] = Pass(name, *texts, getattr(info, "pass"), _PER[info.per])
    return table


def crypto_hash(name: str) -> int:
    """What Cryptomatte calls an object of this name: 32 bits, which its pass holds as a float."""
    return int(library().fum_crypto_hash(name.encode()))
