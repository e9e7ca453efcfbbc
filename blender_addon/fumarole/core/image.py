# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing OpenEXR files."""

from __future__ import annotations

import os
from collections.abc import Mapping

from numpy.typing import ArrayLike

from . import _abi, _arrays
from .context import Context, default_context
from .errors import argument_error
from .passes import passes

CHANNELS = {1: "Y", 2: "XY", 3: "RGB", 4: "RGBA"}


def write_exr(path: str | os.PathLike[str], layers: Mapping[str | tuple[str, int], ArrayLike], context: Context | None = None) -> None:
    """Writes a 32-bit float, ZIP-compressed OpenEXR file. An existing file stays as it was on failure.

    layers: a Result, or pictures (height, width, 1 to 4 channels) by name, all of one size, first row at the bottom.
    Channels are called name.letter ("Depth.Z", of a light's pass ("Light", 2) "Light 2.R"). The layers "Combined" and "" give the file's plain R, G, B, A. A
    layer named as a pass has that pass's letters; others have Y, XY, RGB or RGBA.
    Raises FumaroleError.
    """
    if not layers:
        raise argument_error(f"{os.fspath(path)}: there is no layer to write")
    images = (_abi.fum_image_layer * len(layers))()
    size = None
    kept = []
    for image, (name, value) in zip(images, layers.items()):
        pixels = _arrays.floats(value, f"layer {name!r}")
        if pixels.ndim != 3 or pixels.shape[2] not in CHANNELS:
            raise argument_error(f"layer {name!r} has shape {pixels.shape}, expected (height, width, 1 to 4)")
        size = size or pixels.shape[:2]
        if pixels.shape[:2] != size:
            raise argument_error(f"layer {name!r} is {pixels.shape[:2]}, the first one {size} (height, width)")
        title = name if isinstance(name, str) else f"{name[0]} {name[1]}"
        image.name = b"" if title == "Combined" else title.encode()
        image.channels = _channels(name if isinstance(name, str) else name[0], pixels.shape[2]).encode()
        image.pixels = _arrays.pointer(pixels)
        kept.append(pixels)
    height, width = size
    context = context or default_context()
    context.call("fum_exr_write", context.handle, os.fsencode(path), width, height, len(layers), images)


def _channels(name: str, count: int) -> str:
    known = passes().get(name)
    return known.channels if known and len(known.channels) == count else CHANNELS[count]
