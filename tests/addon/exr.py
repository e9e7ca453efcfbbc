# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the uncompressed single-part OpenEXR files that tests let Blender write."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

_KINDS = {0: "<u4", 1: "<f2", 2: "<f4"}


def read_exr(path: str | Path) -> dict[str, np.ndarray]:
    """Channels by their full name, (height, width), first row at the bottom.

    Raises ValueError for files that are compressed, tiled or have several parts.
    """
    data = Path(path).read_bytes()
    magic, version = struct.unpack_from("<II", data)
    if magic != 20000630 or version & 0x1A00:
        raise ValueError(f"{path}: not a single-part scanline OpenEXR file (version {version:#x})")
    attributes, offset = _attributes(data, 8)
    if attributes["compression"] != b"\0":
        raise ValueError(f"{path}: compressed")
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    channels = _channels(attributes["channels"])
    pictures = {name: np.empty((height, width), dtype=kind) for name, kind in channels}
    for line in struct.unpack_from(f"<{height}Q", data, offset):
        y = struct.unpack_from("<i", data, line)[0]
        start = line + 8
        for name, kind in channels:
            pictures[name][y1 - y] = np.frombuffer(data, kind, width, start)
            start += width * np.dtype(kind).itemsize
    return pictures


def read_metadata(path: str | Path) -> dict[str, bytes]:
    """Attributes of the file, or of its first part, by name."""
    return _attributes(Path(path).read_bytes(), 8)[0]


def stack(pictures: dict[str, np.ndarray], layer: str, letters: str) -> np.ndarray:
    """The channels `layer`.letter as (height, width, number of letters) float32."""
    prefix = f"{layer}." if layer else ""
    return np.stack([pictures[prefix + letter] for letter in letters], axis=-1).astype(np.float32)


def _attributes(data: bytes, offset: int) -> tuple[dict[str, bytes], int]:
    result = {}
    while data[offset]:
        name, offset = _text(data, offset)
        _, offset = _text(data, offset)
        size = struct.unpack_from("<i", data, offset)[0]
        result[name] = data[offset + 4 : offset + 4 + size]
        offset += 4 + size
    return result, offset + 1


def _channels(data: bytes) -> list[tuple[str, str]]:
    result, offset = [], 0
    while data[offset]:
        name, offset = _text(data, offset)
        result.append((name, _KINDS[struct.unpack_from("<i", data, offset)[0]]))
        offset += 16
    return result


def _text(data: bytes, offset: int) -> tuple[str, int]:
    end = data.index(b"\0", offset)
    return data[offset:end].decode(), end + 1
