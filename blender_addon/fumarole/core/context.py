# SPDX-License-Identifier: GPL-3.0-or-later
"""The context: threads, progress, warnings, and the one way in which the C library is called."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from typing import Any

from . import _abi
from ._library import library
from .errors import Cancelled, ErrorCode, FumaroleError, text_of

Progress = Callable[[str, float, str], "bool | None"]

STAGES = {value: name.lower() for name, value in _abi.choices("FUM_STAGE_").items()}


def error_of(code: int, message: str) -> FumaroleError:
    """The exception of a failed call."""
    if code == ErrorCode.CANCELLED:
        return Cancelled(message)
    return FumaroleError(code, message)


class Context:
    """Owner of errors, warnings, threads and progress; scenes are made in one.

    threads: 0 uses all cores, at most 1024.
    progress: called as progress(stage, fraction, message) at least ten times a second during long work, on the thread
        that called. `stage` is "octree", "lighting", "sorting", "drawing" or "passes", `fraction` 0..1 within it.
        Returning True cancels: the call then raises Cancelled. An exception raised inside, KeyboardInterrupt too,
        cancels as well and arrives at the caller. May be replaced at any time: `context.progress = function`.

    A context and its scenes belong to one thread at a time; different contexts are independent. It ends with close(),
    at the end of a `with` block, or with its last reference. Raises FumaroleError.
    """

    def __init__(self, threads: int = 0, progress: Progress | None = None) -> None:
        lib = library()
        handle = ctypes.POINTER(_abi.fum_context)()
        code = lib.fum_context_create(ctypes.byref(handle))
        if code != _abi.FUM_OK:
            raise error_of(code, text_of(lib.fum_last_error(None)))
        self.progress = progress
        self._handle = handle
        self._busy = threading.Lock()
        self._children: weakref.WeakSet[Any] = weakref.WeakSet()
        self._finalizer = weakref.finalize(self, lib.fum_context_destroy, handle)
        self.threads = threads

    @property
    def threads(self) -> int:
        """Number of threads, 0 for all cores. Setting it raises FumaroleError when it is out of range."""
        return self._threads

    @threads.setter
    def threads(self, threads: int) -> None:
        self.call("fum_context_set_threads", self.handle, threads)
        self._threads = threads

    @property
    def handle(self) -> Any:
        """Pointer to the C context. Raises FumaroleError once closed."""
        if not self._finalizer.alive:
            raise FumaroleError(ErrorCode.ARGUMENT, "the context is closed")
        return self._handle

    @property
    def warnings(self) -> list[str]:
        """Warnings since the last clear_warnings(), each once."""
        lib = library()
        count = lib.fum_warning_count(self.handle)
        return [text_of(lib.fum_warning(self.handle, index)) for index in range(count)]

    def clear_warnings(self) -> None:
        library().fum_warnings_clear(self.handle)

    def call(self, function: str, *arguments: Any) -> None:
        """Calls a C function that returns a status, with progress; raises what went wrong."""
        if not self._busy.acquire(blocking=False):
            raise FumaroleError(ErrorCode.ARGUMENT, "the context is busy with another call; use a context a thread")
        try:
            with self._relay_progress() as failures:
                code = getattr(library(), function)(*arguments)
            if failures:
                raise failures[0]
            if code != _abi.FUM_OK:
                raise error_of(code, text_of(library().fum_last_error(self.handle)))
        finally:
            self._busy.release()

    @contextlib.contextmanager
    def _relay_progress(self) -> Iterator[list[BaseException]]:
        """Passes C's progress calls on; exceptions cannot cross C, so they are gathered in the list given out."""
        failures: list[BaseException] = []

        def relay(_user: int | None, stage: int, fraction: float, message: bytes) -> int:
            try:
                if failures or (self.progress and self.progress(STAGES[stage], fraction, text_of(message))):
                    return 1
            except BaseException as error:
                failures.append(error)
                return 1
            return 0

        callback = _abi.fum_progress_fn(relay)
        library().fum_context_set_progress(self.handle, callback, None)
        try:
            with _catch_interrupts(relay, failures):
                yield failures
        finally:
            library().fum_context_set_progress(self.handle, _abi.fum_progress_fn(), None)

    def close(self) -> None:
        """Destroys what was made in this context and the context. Later use raises FumaroleError."""
        for child in list(self._children):
            child.close()
        self._finalizer()

    def __enter__(self) -> Context:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()


@contextlib.contextmanager
def _catch_interrupts(relay: Callable[..., int], failures: list[BaseException]) -> Iterator[None]:
    """Gathers an interrupt that Python raises at the first instruction of `relay`, where no `try` can catch it.

    ctypes hands such an exception to sys.unraisablehook and goes on. Signals reach the main thread only.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = sys.unraisablehook

    def hook(unraisable: Any) -> None:
        if unraisable.object is relay or "ctypes callback" in (unraisable.err_msg or ""):
            failures.append(unraisable.exc_value)
        else:
            previous(unraisable)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = previous


@functools.cache
def default_context() -> Context:
    """The context of scenes made without one: all cores, no progress."""
    return Context()
