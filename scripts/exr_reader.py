# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads single-part, scanline, 32-bit float OpenEXR files, flat and deep; shares no code with what writes them."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

LINES_PER_BLOCK = {0: 1, 2: 1, 3: 16}  # none, ZIPS, ZIP
FLOAT = 2


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """Channels by name, (height, width) float32, first row at the bottom."""
    data = path.read_bytes()
    magic, version = struct.unpack_from("<II", data)
    assert magic == 20000630 and version & 0xFF == 2 and not version & 0x1A00, "no plain scanline OpenEXR file"
    attributes, position = read_attributes(data, 8)
    names = read_channels(attributes["channels"])
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    lines = LINES_PER_BLOCK[attributes["compression"][0]]
    picture = np.empty((height, len(names), width), np.float32)
    for (offset,) in struct.iter_unpack("<Q", data[position : position + 8 * -(-height // lines)]):
        y, size = struct.unpack_from("<iI", data, offset)
        rows = min(lines, y1 + 1 - y)
        block = unpack(data[offset + 8 : offset + 8 + size], 4 * rows * len(names) * width)
        picture[y - y0 : y - y0 + rows] = np.frombuffer(block, "<f4").reshape(rows, len(names), width)
    return {name: picture[::-1, index] for index, name in enumerate(names)}


def read_deep(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Of a deep file with the channels R, G, B, A, Z, ZBack: the number of samples of each pixel (height, width) uint32,
    first row at the bottom, and all samples (n, 6) float32 in that order, pixel after pixel."""
    data = path.read_bytes()
    magic, version = struct.unpack_from("<II", data)
    assert magic == 20000630 and version & 0xFF == 2 and version & 0x1A00 == 0x0800, "no deep OpenEXR file"
    attributes, position = read_attributes(data, 8)
    names = read_channels(attributes["channels"])
    order = [names.index(name) for name in ("R", "G", "B", "A", "Z", "ZBack")]
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    counts = np.empty((height, width), np.uint32)
    rows = {}
    for (offset,) in struct.iter_unpack("<Q", data[position : position + 8 * height]):
        y, counts_size, size, unpacked_size = struct.unpack_from("<iQQQ", data, offset)
        start = offset + 28
        sums = unpack(data[start : start + counts_size], 4 * width)
        counts[y1 - y] = np.diff(np.frombuffer(sums, "<u4"), prepend=np.uint32(0))
        block = unpack(data[start + counts_size : start + counts_size + size], unpacked_size)
        rows[y1 - y] = np.frombuffer(block, "<f4").reshape(len(names), -1).T[:, order]
    return counts, np.concatenate([rows[y] for y in range(height)])


def unpack(block: bytes, size: int) -> bytes:
    return block if len(block) == size else undo_filters(zlib.decompress(block))


def read_attributes(data: bytes, position: int) -> tuple[dict[str, bytes], int]:
    attributes = {}
    while data[position]:
        name, _kind, rest = data[position:].split(b"\0", 2)
        position = len(data) - len(rest)
        (size,) = struct.unpack_from("<I", data, position)
        attributes[name.decode()] = data[position + 4 : position + 4 + size]
        position += 4 + size
    return attributes, position + 1


def read_channels(data: bytes) -> list[str]:
    names = []
    while data[0]:
        name, data = data.split(b"\0", 1)
        kind, _linear, step_x, step_y = struct.unpack_from("<IIII", data)
        assert (kind, step_x, step_y) == (FLOAT, 1, 1)
        names.append(name.decode())
        data = data[16:]
    return names


def undo_filters(block: bytes) -> bytes:
    """Undoes the differences between bytes and the split in even and odd ones."""
    steps = np.frombuffer(block, np.uint8).astype(np.int64)
    steps[1:] -= 128
    values = (np.cumsum(steps) & 0xFF).astype(np.uint8)
    half = (len(values) + 1) // 2
    out = np.empty_like(values)
    out[0::2], out[1::2] = values[:half], values[half:]
    return out.tobytes()
