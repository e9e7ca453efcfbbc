# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of the library and of wrong arguments as exceptions."""

from __future__ import annotations

import enum

from . import _abi

ErrorCode = enum.IntEnum("ErrorCode", _abi.choices("FUM_ERROR_"))
ErrorCode.__doc__ = """Kind of a FumaroleError: ARGUMENT, MEMORY, CANCELLED, DEVICE, LIBRARY or FILE, numbered as in fumarole.h."""


class FumaroleError(Exception):
    """A call failed. The text is a sentence for a person that names the object and the value that was wrong.

    `code` is an ErrorCode.
    """

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = ErrorCode(code)


class Cancelled(FumaroleError):
    """The progress callback asked to stop. The scene is as it was before the call."""

    def __init__(self, message: str = "the render was cancelled") -> None:
        super().__init__(ErrorCode.CANCELLED, message)


def text_of(message: bytes | None) -> str:
    """A text from the library, which may have cut it in the middle of a character."""
    return (message or b"").decode(errors="replace")


def argument_error(message: str) -> FumaroleError:
    """The error of a wrong argument that was found before the library was called."""
    return FumaroleError(ErrorCode.ARGUMENT, message)
