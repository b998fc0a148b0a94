"""Visibility, nearest hits and pictures by displacement fields: the C interface of Fieldtrace for numpy."""

from . import _core
from ._arrays import NO_INSTANCE
from ._errors import Cancelled, Error, ErrorCode, InputError, InvalidArgument, InvalidOperation, OutOfMemory
from ._scene import Hit, Hits, Light, Occlusion, Scene, Visibility, load_scene, render

__all__ = [
    "NO_INSTANCE",
    "Cancelled",
    "Error",
    "ErrorCode",
    "Hit",
    "Hits",
    "InputError",
    "InvalidArgument",
    "InvalidOperation",
    "Light",
    "Occlusion",
    "OutOfMemory",
    "Scene",
    "Visibility",
    "__version__",
    "load_scene",
    "render",
]

_version = _core.version()
__version__ = f"{_version // 10000}.{_version // 100 % 100}.{_version % 100}"
