# SPDX-License-Identifier: GPL-3.0-or-later
"""The smoke in depth: samples for compositing."""

from __future__ import annotations

import ctypes
import os
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _abi
from ._library import library
from .context import Context
from .errors import ErrorCode, FumaroleError


class Deep:
    """A picture whose pixels hold samples of the smoke, nearest first, which don't overlap.

    A sample is smoke spread evenly from its depth to its depth_back: its nearest part, a share f of its length, has the
    opacity 1 - (1 - a)^f, and of its radiance a share as of its opacity. Over one another the samples of a pixel make
    Combined.

    It ends with close(), at the end of a `with` block, with its context, or with its last reference.
    """

    def __init__(self, handle: Any, height: int, width: int, context: Context) -> None:
        self._handle = handle
        self._context = context
        self._shape = (height, width)
        # The context is among the arguments so that it lives at least as long.
        self._finalizer = weakref.finalize(self, _destroy, handle, context)
        context._children.add(self)

    @property
    def handle(self) -> Any:
        """Pointer to the C picture. Raises FumaroleError once closed."""
        if not self._finalizer.alive:
            raise FumaroleError(ErrorCode.ARGUMENT, "the deep pixels are closed")
        return self._handle

    @property
    def counts(self) -> NDArray[np.uint32]:
        """Number of samples of each pixel, (height, width), first row at the bottom."""
        counts, _samples, _count = self._arrays()
        return np.ctypeslib.as_array(counts, self._shape).copy()

    @property
    def samples(self) -> NDArray[np.float32]:
        """Samples, pixel after pixel: (n, 6), premultiplied R, G, B, A of each alone, depth and depth_back along the
        camera's axis, m."""
        _counts, samples, count = self._arrays()
        if count == 0:
            return np.empty((0, 6), np.float32)
        floats = ctypes.cast(samples, ctypes.POINTER(ctypes.c_float))
        return np.ctypeslib.as_array(floats, (count, 6)).copy()

    def write(self, path: str | os.PathLike[str], frame: tuple[int, int, int, int] | None = None) -> None:
        """Writes a deep scanline OpenEXR file with the channels R, G, B, A, Z, ZBack. An existing file stays as it was
        on failure.

        frame: width and height of the frame that the picture is a part of, and the picture's left and bottom in it,
        pixels. None: the picture is all of it. Raises FumaroleError.
        """
        part = None if frame is None else ctypes.byref(_abi.fum_frame_part(*frame))
        self._context.call("fum_deep_write", self.handle, os.fsencode(path), part)

    def close(self) -> None:
        """Frees the samples. Later use raises FumaroleError."""
        self._finalizer()

    def __enter__(self) -> Deep:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def _arrays(self) -> tuple[Any, Any, int]:
        counts = ctypes.POINTER(ctypes.c_uint32)()
        samples = ctypes.POINTER(_abi.fum_deep_sample)()
        count = library().fum_deep_samples(self.handle, ctypes.byref(counts), ctypes.byref(samples))
        return counts, samples, count


def _destroy(handle: Any, _context: Context) -> None:
    library().fum_deep_destroy(handle)
