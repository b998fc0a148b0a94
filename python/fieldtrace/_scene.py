"""Scenes: what the C interface offers, for numpy. docs/python.md shows how it goes together."""

from __future__ import annotations

import enum
import operator
import os
import sys
import warnings
from typing import Callable, NamedTuple, NoReturn, Optional, Sequence, SupportsFloat, SupportsIndex, Union, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _core
from ._arrays import Path

__all__ = ["Hit", "Hits", "Light", "Occlusion", "Scene", "Visibility", "load_scene", "render"]

Progress = Callable[[float], object]
"""Called on the thread that made the call, now and then, with the share of the work done; what it raises cancels."""


class Occlusion(enum.IntEnum):
    CLEAR = 0
    BLOCKED = 1
    UNDECIDED = 2


class Hit(enum.IntEnum):
    MISS = 0
    HIT = 1
    UNDECIDED = 2


class Hits(NamedTuple):
    """Nearest hits; arrays of the rays' shape. Where `status` is not Hit.HIT: inf, 0 and 0xffffffff."""

    status: NDArray[np.uint8]
    """Hit.MISS, Hit.HIT or Hit.UNDECIDED"""
    t: NDArray[np.float32]
    """in multiples of the direction"""
    normals: NDArray[np.float32]
    """(..., 3), unit, geometric, on the side that the ray comes from"""
    triangles: NDArray[np.uint32]
    """of the mesh; of certified hits one near by"""
    instances: NDArray[np.uint32]


class Visibility(NamedTuple):
    shares: NDArray[np.float32]
    """what is seen, in [0, 1]"""
    certain: NDArray[np.float32]
    """how much of the answer fields or bounds certified, in [0, 1]"""


class Light(NamedTuple):
    """A light's shape, for Scene.light_visibility(). World space."""

    shape: int
    """0 sphere, 1 disk, 2 rectangle"""
    numbers: tuple[float, ...]
    """centre and two half axes, 9 in all"""

    @classmethod
    def sphere(cls, centre: ArrayLike, radius: SupportsFloat) -> Light:
        return cls(0, (*_arrays.triple("centre", centre), float(radius), 0.0, 0.0, 0.0, 0.0, 0.0))

    @classmethod
    def disk(cls, centre: ArrayLike, u: ArrayLike, v: ArrayLike) -> Light:
        """centre + a u + b v, a^2 + b^2 <= 1; seen on the side of u x v only."""
        return cls(1, _numbers(centre, u, v))

    @classmethod
    def rectangle(cls, centre: ArrayLike, u: ArrayLike, v: ArrayLike) -> Light:
        """centre + a u + b v, a and b in [-1, 1]; seen on the side of u x v only."""
        return cls(2, _numbers(centre, u, v))


def _numbers(centre: ArrayLike, u: ArrayLike, v: ArrayLike) -> tuple[float, ...]:
    return (*_arrays.triple("centre", centre), *_arrays.triple("u", u), *_arrays.triple("v", v))


class Scene:
    """Meshes, instances of them, and what answers rays among them.

    Arrays: float32 is read in place where the three numbers of a row lie side by side and rows follow one another
    forwards, at any distance; other numbers and layouts are converted to that first. Wrong kinds are a TypeError, wrong
    shapes a ValueError, what the library refuses an Error with its message.

    Space: world, right-handed, any unit; matrices are (3, 4) or (4, 4), as in `matrix @ column`. t is in multiples of the
    direction, which need not be unit.

    Threads: methods may be called from any thread, and release the GIL while they work. Queries run beside one another
    and beside bake(); commit() and changes wait for them.
    """

    __slots__ = ("_core", "__weakref__")

    def __init__(self, threads: SupportsIndex = 0) -> None:
        """`threads` that work on each call; 0: all of the machine."""
        self._core = _core.Scene(_arrays.number("threads", threads))

    def __reduce__(self) -> NoReturn:
        raise TypeError("a fieldtrace.Scene cannot be pickled or copied: make it again, or load its fields from files")

    # ---- What is in it ----

    def add_mesh(self, positions: ArrayLike, triangles: ArrayLike) -> int:
        """Positions (n, 3) and triangles (m, 3), both copied; before the first commit only. Returns its number."""
        return self._core.add_mesh(_arrays.positions(positions), _arrays.triangles(triangles))

    def add_instance(self, mesh: SupportsIndex, transform: Optional[ArrayLike] = None) -> int:
        """Places a mesh in the world, by default where it is; before the first commit only. Returns its number."""
        columns = None if transform is None else _arrays.transform(transform)
        return self._core.add_instance(_arrays.number("mesh", mesh), columns)

    def set_transform(self, instance: SupportsIndex, transform: ArrayLike) -> None:
        """Object to world. Takes effect with the next commit; fields are kept."""
        self._core.set_transform(_arrays.number("instance", instance), _arrays.transform(transform))

    def set_reflectance(self, instance: SupportsIndex, rgb: ArrayLike) -> None:
        """For render(): two-sided diffuse reflectance, in [0, 1], a number or three. By default .5."""
        self._core.set_reflectance(_arrays.number("instance", instance), _arrays.rgb("rgb", rgb))

    def set_radiance(self, instance: SupportsIndex, rgb: ArrayLike) -> None:
        """For render(): what it sends on the side of its geometric normal."""
        self._core.set_radiance(_arrays.number("instance", instance), _arrays.rgb("rgb", rgb))

    def set_sky(self, rgb: ArrayLike) -> None:
        """For render(): radiance from everywhere around."""
        self._core.set_sky(_arrays.rgb("rgb", rgb))

    def set_camera(
        self,
        origin: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0.0, 1.0, 0.0),
        fov: SupportsFloat = 45.0,
        width: SupportsIndex = 512,
        height: SupportsIndex = 512,
    ) -> None:
        """For render(): a pinhole; `fov` is horizontal, in degrees; `up` points up in the picture; pixels."""
        self._core.set_camera(
            _arrays.triple("origin", origin),
            _arrays.triple("target", target),
            _arrays.triple("up", up),
            float(fov),
            _arrays.number("width", width),
            _arrays.number("height", height),
        )

    def set(self, **settings: Union[SupportsIndex, SupportsFloat]) -> None:
        """Settings by name, as ftSetSceneInt() and ftSetSceneFloat() list them: spp, seed, max_depth, montecarlo;
        directions, plane and field_memory before the first commit; tolerance, from the next commit on."""
        for name, value in settings.items():
            if name == "tolerance":
                self._core.set_float(name, float(value))
                continue
            try:
                integer = operator.index(value)  # type: ignore[arg-type]
            except TypeError:
                raise TypeError(f"{name}: expected an integer, got {type(value).__name__}") from None
            if not -(2**63) <= integer < 2**63:
                raise ValueError(f"{name}: expected an integer of 64 bits, got {integer}")
            self._core.set_int(name, integer)

    def get(self, name: str) -> Union[int, float]:
        """By name: meshes, instances, width, height; of all fields: fields, directions, plane, bytes, cells_baked,
        cells_certified, cells_full, memory_exceeded; of the queries so far: certified_occlusion, certified_hits."""
        if name in ("certified_occlusion", "certified_hits"):
            return self._core.get_float(name)
        return self._core.get_int(name)

    def get_mesh(self, mesh: SupportsIndex, name: str) -> int:
        """Of a mesh's field, by name: bytes, cells_baked, cells_certified, cells_full; 0 if it has none."""
        return self._core.get_mesh_int(_arrays.number("mesh", mesh), name)

    @property
    def origin(self) -> NDArray[np.float64]:
        """(3,): scene files are re-centred. The file's coordinates are those used here plus this."""
        return np.array(self._core.origin())

    def commit(self) -> None:
        """Makes the scene as it was set answer queries. Builds what exact rays need anew; keeps all fields."""
        self._core.commit()

    # ---- Fields ----

    def bake(self, progress: Optional[Progress] = None) -> None:
        """Bakes all fields whole; otherwise each part is baked once many rays have asked for it. Ctrl-C, and what
        `progress` raises, cancel; what is baked is kept."""
        self._core.bake(progress)

    def save_field(self, mesh: SupportsIndex, path: Path) -> None:
        """What is baked of a mesh's field, as a .vdb file."""
        self._core.save_field(_arrays.number("mesh", mesh), _arrays.path(path))

    def load_field(self, mesh: SupportsIndex, path: Path) -> None:
        """Adds what a file holds to the field of a mesh, which must have its geometry and resolution."""
        self._core.load_field(_arrays.number("mesh", mesh), _arrays.path(path))

    # ---- Queries ----

    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        tmax: Optional[ArrayLike] = None,
        from_instances: Optional[ArrayLike] = None,
    ) -> NDArray[np.bool_]:
        """True where something lies on the ray before tmax. Fields answer what they certify, exact rays the rest.

        Origins and directions (..., 3); tmax (...), by default infinite, negative: no ray; from_instances (...): the
        instance that a ray leaves, or NO_INSTANCE. Shapes are broadcast. Returns (...).
        """
        results = self._occluded(False, origins, directions, tmax, from_instances)
        return results.view(np.bool_)

    def occluded_certified(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        tmax: Optional[ArrayLike] = None,
        from_instances: Optional[ArrayLike] = None,
    ) -> NDArray[np.uint8]:
        """As occluded() without exact rays: Occlusion.CLEAR, BLOCKED or UNDECIDED."""
        return self._occluded(True, origins, directions, tmax, from_instances)

    def _occluded(
        self,
        certified: bool,
        origins: ArrayLike,
        directions: ArrayLike,
        tmax: Optional[ArrayLike],
        from_instances: Optional[ArrayLike],
    ) -> NDArray[np.uint8]:
        rays, shape = _rays(origins, directions, tmax, from_instances)
        results = np.empty(rays[0].shape[0], np.uint8)
        self._core.occluded(certified, *rays, results)
        return results.reshape(shape)

    def nearest(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        tmax: Optional[ArrayLike] = None,
        from_instances: Optional[ArrayLike] = None,
        max_error: SupportsFloat = 0.01,
    ) -> Hits:
        """Nearest hits of rays as in occluded().

        A certified hit lies within `max_error` x its distance of the surface, in (0, 1]. Meshes without fields are
        traced, and never undecided.
        """
        rays, shape = _rays(origins, directions, tmax, from_instances)
        count = rays[0].shape[0]
        status = np.empty(count, np.uint8)
        t = np.full(count, np.inf, np.float32)
        normals = np.zeros((count, 3), np.float32)
        triangles = np.full(count, _arrays.NO_INSTANCE, np.uint32)
        instances = np.full(count, _arrays.NO_INSTANCE, np.uint32)
        self._core.nearest(float(max_error), *rays, status, t, normals, triangles, instances)
        return Hits(
            status.reshape(shape),
            t.reshape(shape),
            normals.reshape(*shape, 3),
            triangles.reshape(shape),
            instances.reshape(shape),
        )

    def light_visibility(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        lights: Union[Light, Sequence[Light]],
        from_instances: Optional[ArrayLike] = None,
    ) -> Visibility:
        """What points see of lights: the mean over 16 parts of a light's solid angle (disks: area) that lie above the
        point's horizon and face it.

        Points and unit geometric normals (..., 3). Returns shapes (..., lights), or (...) for a single Light.
        """
        single = isinstance(lights, Light)
        given: Sequence[Light] = [lights] if isinstance(lights, Light) else lights
        for light in given:
            if not isinstance(light, Light):
                raise TypeError(f"lights: expected Light.sphere(), disk() or rectangle(), got {type(light).__name__}")
        at, shape = _points(points, normals)
        numbers = np.array([light.numbers for light in given], np.float32).reshape(-1, 9)
        shapes = np.array([light.shape for light in given], np.uint32)
        shares, certain = (np.empty(at[0].shape[0] * len(given), np.float32) for _ in range(2))
        of = _arrays.flat_instances("from_instances", from_instances, shape)
        self._core.light_visibility(*at, of, shapes, numbers, shares, certain)
        result_shape = shape if single else (*shape, len(given))
        return Visibility(shares.reshape(result_shape), certain.reshape(result_shape))

    def sky_visibility(self, points: ArrayLike, normals: ArrayLike, from_instances: ArrayLike) -> Visibility:
        """The cosine-weighted share of the sky that points on instances see: 1 is an open hemisphere.

        Points and unit geometric normals (..., 3). The first call after a commit bakes direction maps.
        """
        at, shape = _points(points, normals)
        of = _arrays.flat_instances("from_instances", from_instances, shape)
        if of is None:
            raise TypeError("from_instances: expected the instances that the points lie on, got None")
        shares, certain = (np.empty(at[0].shape[0], np.float32) for _ in range(2))
        self._core.sky_visibility(*at, of, shares, certain)
        return Visibility(shares.reshape(shape), certain.reshape(shape))

    # ---- Pictures ----

    def render(self, progress: Optional[Progress] = None) -> NDArray[np.float32]:
        """Linear radiance, RGB, (height, width, 3), row 0 at the top. Ctrl-C, and what `progress` raises, cancel."""
        pixels = np.empty((self._core.get_int("height"), self._core.get_int("width"), 3), np.float32)
        self._core.render(pixels, progress)
        _warn(self._core)
        return pixels

    def render_to_file(self, path: Path, progress: Optional[Progress] = None) -> None:
        """The same to .exr or .png."""
        self._core.render_to_file(_arrays.path(path), progress)
        _warn(self._core)


def _warn(core: _core.Scene) -> None:
    """Issues the library's warnings as Python's, at the first line that is not this package's."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__") == __name__:
        level, frame = level + 1, frame.f_back
    for message in core.take_warnings():
        warnings.warn(os.fsdecode(message), stacklevel=level)


_Rows = NDArray[np.float32]
_RayArrays = tuple[_Rows, _Rows, Optional[NDArray[np.float32]], Optional[NDArray[np.uint32]]]


def _rays(
    origins: ArrayLike, directions: ArrayLike, tmax: Optional[ArrayLike], from_instances: Optional[ArrayLike]
) -> tuple[_RayArrays, _arrays.Shape]:
    """((origins, directions, tmax, from_instances), shape): flat arrays, and the shape that they stand for."""
    o, d = _arrays.rows("origins", origins), _arrays.rows("directions", directions)
    shape = _arrays.common_shape(origins=o, directions=d)
    return (
        _arrays.flat_rows(o, shape),
        _arrays.flat_rows(d, shape),
        _arrays.flat_floats("tmax", tmax, shape),
        _arrays.flat_instances("from_instances", from_instances, shape),
    ), shape


def _points(points: ArrayLike, normals: ArrayLike) -> tuple[tuple[_Rows, _Rows], _arrays.Shape]:
    p, n = _arrays.rows("points", points), _arrays.rows("normals", normals)
    shape = _arrays.common_shape(points=p, normals=n)
    return (_arrays.flat_rows(p, shape), _arrays.flat_rows(n, shape)), shape


def load_scene(path: Path, threads: SupportsIndex = 0) -> Scene:
    """A scene file in the subset of Mitsuba's format that `fieldtrace render` reads; committed. See Scene.origin.

    What the file says and is rendered otherwise is a UserWarning.
    """
    scene = Scene.__new__(Scene)
    scene._core = _core.Scene.load(_arrays.path(path), _arrays.number("threads", threads))
    _warn(scene._core)
    return scene


@overload
def render(
    path: Path,
    output: None = None,
    threads: SupportsIndex = 0,
    progress: Optional[Progress] = None,
    **settings: Union[SupportsIndex, SupportsFloat],
) -> NDArray[np.float32]: ...
@overload
def render(
    path: Path,
    output: Path,
    threads: SupportsIndex = 0,
    progress: Optional[Progress] = None,
    **settings: Union[SupportsIndex, SupportsFloat],
) -> None: ...
def render(
    path: Path,
    output: Optional[Path] = None,
    threads: SupportsIndex = 0,
    progress: Optional[Progress] = None,
    **settings: Union[SupportsIndex, SupportsFloat],
) -> Optional[NDArray[np.float32]]:
    """Renders a scene file: Scene.render() of it, or, with `output`, to a file, .exr or .png, and returns None.

    `settings` as in Scene.set() after a commit: spp=16, say; by default the scene file's.
    """
    scene = load_scene(path, threads)
    scene.set(**settings)
    if "tolerance" in settings:
        scene.commit()
    if output is None:
        return scene.render(progress)
    scene.render_to_file(output, progress)
    return None
