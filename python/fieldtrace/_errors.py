"""Exceptions, one for each error of the library. Their text is the library's message."""

from __future__ import annotations

import enum

__all__ = ["Cancelled", "Error", "ErrorCode", "InputError", "InvalidArgument", "InvalidOperation", "OutOfMemory"]


class ErrorCode(enum.IntEnum):
    """Numbers of `FTError` in fieldtrace/fieldtrace.h."""

    INVALID_ARGUMENT = 1
    INVALID_OPERATION = 2
    INPUT = 3
    OUT_OF_MEMORY = 4
    CANCELLED = 5
    UNKNOWN = 6


class Error(RuntimeError):
    """An error of the library; `code` says which."""

    code: ErrorCode = ErrorCode.UNKNOWN


class InvalidArgument(Error, ValueError):
    """Numbers, names or arrays that the library refuses."""

    code = ErrorCode.INVALID_ARGUMENT


class InvalidOperation(Error):
    """The wrong order: a query before the first commit, say."""

    code = ErrorCode.INVALID_OPERATION


class InputError(Error):
    """A file that is missing, damaged or does not fit, or a scene that cannot be rendered."""

    code = ErrorCode.INPUT


class OutOfMemory(Error, MemoryError):
    code = ErrorCode.OUT_OF_MEMORY


class Cancelled(Error):
    """Long work was cancelled. What cancels it in Python raises its own exception instead."""

    code = ErrorCode.CANCELLED


_TYPES = {kind.code: kind for kind in (InvalidArgument, InvalidOperation, InputError, OutOfMemory, Cancelled)}


def error_of(code: int, message: str) -> Error:
    """Called by the extension."""
    return _TYPES.get(ErrorCode(code), Error)(message)
