"""Embree: triangles in an accelerator, and rays against them. Only the tracer uses this file.

The embreex wheel carries Embree's own library. `Direct` calls it by its C interface from the kernels in `embree.c`: the
rays of a whole batch are made and traced in one native call, 8 or 16 shadow rays at once, and nothing but that call is
needed, in which other Python threads run. `ByRun` does the same by embreex's `EmbreeScene.run`; it is used where the
library is not found or is of another version than 4, and with LIGHT_MESHES_EMBREE=run in the environment. Tests compare
the two: they answer alike, bit by bit.

Rays come in the tracer's frame (`frame.py`). Where rays are ready made, o and d (n,3) are origins and directions and
t (n,) is how far they go in units of |d|, all float32.
"""

from __future__ import annotations

import ctypes
import functools
import os
import sys
import threading
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import embreex
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from ..support import processors
from ..support.native import kernel

CHUNK = 16384  # rays that `run` is given at once

make_rays, make_segments = kernel("tracer_rays"), kernel("tracer_segments")
_closest, _occluded = kernel("embree_closest"), kernel("embree_occluded")
_closest_of, _occluded_of = kernel("embree_closest_of"), kernel("embree_occluded_of")
_closest_of_pixels = kernel("embree_closest_of_pixels")
_around, _directions = kernel("embree_around"), kernel("tracer_directions")
_lit, _near = kernel("embree_lit"), kernel("embree_near")

VERSION = 4  # of Embree, whose structs embree.c knows
_ROBUST = 4  # RTC_SCENE_FLAG_ROBUST: without it rays slip through edges
_TRIANGLES, _INDEX, _VERTEX, _UINT3, _FLOAT3 = 0, 0, 1, 0x5003, 0x9003  # RTCGeometryType, RTCBufferType, RTCFormat
_MAJOR, _NATIVE_16 = 1, 34  # RTC_DEVICE_PROPERTY_VERSION_MAJOR, …_NATIVE_RAY16_SUPPORTED
_OUT_OF_MEMORY = 4  # RTCError


class Accelerator(Protocol):
    """The triangles of a scene, ready for rays. All of it can be called from several threads at once."""

    @property
    def for_kernels(self) -> tuple[int, int, int] | None:
        """Embree's function for packets of shadow rays, their size, and the scene, for kernels that call it; None: they
        cannot.
        """

    @property
    def closest_for_kernels(self) -> tuple[int, int]:
        """Embree's function for the first triangle on a ray, and the scene, where `for_kernels` is not None."""

    def closest(self, o: NDArray[np.float32], d: NDArray[np.float32], t: NDArray[np.float32]) -> Met:
        """Return the first triangle on each of some ready-made rays; t becomes how far it is."""

    def occluded(self, o: NDArray[np.float32], d: NDArray[np.float32], t: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Return whether any triangle is on each of some ready-made rays (n,)."""

    def closest_of(self, *rays: Any) -> Met:
        """Return the same as `closest` of the rays that the kernel tracer_rays makes of its first arguments."""

    def occluded_of(self, *segments: Any) -> NDArray[np.bool_]:
        """Return the same as `occluded` of the rays that the kernel tracer_segments makes of its first arguments."""

    def closest_of_pixels(self, *rays: Any) -> Met:
        """Return what the kernel embree_closest_of_pixels finds with the arguments behind `scene`: the same as
        `closest_of`, faster for rays from the camera.
        """

    def around(self, *rays: Any) -> Met:
        """Return what the kernel embree_around finds with the arguments behind `scene`."""

    def lit(self, *points: Any) -> int:
        """Do what the kernel embree_lit does with the arguments behind `scene`."""

    def near(self, *points: Any) -> int:
        """Do what the kernel embree_near does with the arguments behind `scene`, and return 0."""


class Met(NamedTuple):
    """The surfaces that rays meet."""

    triangle: NDArray[np.int32]  # (n,) −1: none
    u: NDArray[np.float32]  # (n,) barycentrics
    v: NDArray[np.float32]


def _nothing(n: int) -> Met:
    return Met(np.empty(n, np.int32), np.empty(n, np.float32), np.empty(n, np.float32))


def accelerator(vertices: NDArray[np.float32], triangles: NDArray[np.int32]) -> Accelerator:
    """Return the accelerator of triangles (T,3) of vertices (V,3). Raises MemoryError."""
    return Direct(vertices, triangles) if _device() else ByRun(vertices, triangles)


class ByRun:
    """The accelerator by embreex's Python interface."""

    for_kernels: tuple[int, int, int] | None = None
    closest_for_kernels = 0, 0

    def __init__(self, vertices: NDArray[np.float32], triangles: NDArray[np.int32]) -> None:
        self._scene = EmbreeScene()  # robust is its default
        if len(triangles):
            TriangleMesh(self._scene, vertices, triangles)
        empty = np.zeros((1, 3), np.float32)
        self._scene.run(empty, empty + 1, query="OCCLUDED")  # commits; later calls come from several threads

    def closest(self, o: NDArray[np.float32], d: NDArray[np.float32], t: NDArray[np.float32]) -> Met:
        """See Accelerator."""
        met = self._scene.run(o, d, dists=t, query="INTERSECT", output=True)
        return Met(met["primID"], met["u"], met["v"])

    def occluded(self, o: NDArray[np.float32], d: NDArray[np.float32], t: NDArray[np.float32]) -> NDArray[np.bool_]:
        """See Accelerator."""
        blocked: NDArray[np.bool_] = self._scene.run(o, d, dists=t, query="OCCLUDED") == 0
        return blocked

    def closest_of(self, *rays: Any) -> Met:
        """See Accelerator."""
        *frame, origin, direction, normal, length = rays
        met = _nothing(len(origin))
        for i in range(0, len(origin), CHUNK):
            part = slice(i, min(i + CHUNK, len(origin)))
            made = room_for(part.stop - i)
            make_rays(*frame, origin[part], direction[part], None if normal is None else normal[part],
                      None if length is None else length[part], *made)
            for whole, found in zip(met, self.closest(*made), strict=True):
                whole[part] = found
        return met

    def closest_of_pixels(self, *rays: Any) -> Met:
        """See Accelerator."""
        _, _, _, _, *frame, origin, direction, length = rays
        return self.closest_of(*frame, origin, direction, None, length)

    def around(self, *rays: Any) -> Met:
        """See Accelerator."""
        *frame, P, M, turn, local = rays
        n, d = len(P), len(local)
        direction = np.empty((n * d, 3))
        _directions(M, turn, local, np.arange(n * d), direction)
        return self.closest_of(*frame, np.repeat(P, d, axis=0), direction, np.repeat(M, d, axis=0), None)

    def occluded_of(self, *segments: Any) -> NDArray[np.bool_]:
        """See Accelerator."""
        *first, origin_of, position, directional, target_of, closed = segments
        blocked = np.empty(len(origin_of), np.bool_)
        for i in range(0, len(origin_of), CHUNK):
            part = slice(i, min(i + CHUNK, len(origin_of)))
            made = room_for(part.stop - i)
            make_segments(*first, origin_of[part], position, directional, target_of[part], closed, *made)
            blocked[part] = self.occluded(*made)
        return blocked

    def lit(self, *points: Any) -> int:
        """See Accelerator."""
        *frame, origin, position, directional, asked, among, first, last, found = points
        total = 0
        for i in range(first, min(last, len(position))):
            word, bit = i >> 6, np.uint64(1) << np.uint64(i & 63)
            row = np.flatnonzero(asked[:, word] & among[word] & bit).astype(np.int32)
            blocked = self.occluded_of(*frame, origin, None, row, position, directional, np.full_like(row, i), False)
            found[row[~blocked], word] |= bit
            total += len(row)
        return total

    def near(self, *points: Any) -> int:
        """See Accelerator."""
        *frame, origin, normal, position, start, end, target, most, seen, state = points
        first, count = state[0], np.maximum(end - start[:, 0], 0)
        last = first + int(np.searchsorted(np.cumsum(count[first:]), most)) + 1
        some = slice(first, min(last, len(count)))
        row = np.repeat(np.arange(len(count), dtype=np.int32)[some], count[some])
        index = np.arange(len(row)) + np.repeat(start[some, 0] - (np.cumsum(count[some]) - count[some]), count[some])
        row, index = row[~seen[index]], index[~seen[index]]
        free = np.zeros(len(position), np.bool_)
        seen[index] = ~self.occluded_of(*frame, origin, normal, row, position, free, target[index], True)
        state[:] = some.stop, state[1] + len(row)
        return 0


class Direct:
    """The accelerator by Embree's C interface."""

    def __init__(self, vertices: NDArray[np.float32], triangles: NDArray[np.int32]) -> None:
        """triangles: the array is kept and not copied."""
        device = _device()
        assert device is not None
        e, self._release = device.library, device.library.rtcReleaseScene
        self._triangles = np.ascontiguousarray(triangles, np.int32)
        self._scene = e.rtcNewScene(device.address)
        e.rtcSetSceneFlags(self._scene, _ROBUST)
        if len(triangles):
            vertices = np.ascontiguousarray(vertices, np.float32)
            geometry = e.rtcNewGeometry(device.address, _TRIANGLES)
            e.rtcSetSharedGeometryBuffer(geometry, _INDEX, 0, _UINT3, self._triangles.ctypes.data, 0, 12,
                                         len(self._triangles))
            place = e.rtcSetNewGeometryBuffer(geometry, _VERTEX, 0, _FLOAT3, 12, len(vertices))  # it reads past the end
            if place:
                ctypes.memmove(place, vertices.ctypes.data, vertices.nbytes)
            e.rtcCommitGeometry(geometry)
            e.rtcAttachGeometry(self._scene, geometry)
            e.rtcReleaseGeometry(geometry)
        e.rtcCommitScene(self._scene)
        error = e.rtcGetDeviceError(device.address)
        if error == _OUT_OF_MEMORY:
            raise MemoryError
        if error:
            raise RuntimeError(f"Embree cannot build its accelerator of {len(triangles):,} triangles: error {error}")
        self.closest_for_kernels = device.closest, self._scene
        self._for_pixels = device.closest, device.packets, self._scene
        self._for_occluded: tuple[int, int, int] = (*device.occluded, self._scene)
        self.for_kernels: tuple[int, int, int] | None = self._for_occluded
        self.lit, self.near = _lit.of(*self._for_occluded), _near.of(*self._for_occluded)

    def __del__(self) -> None:
        if getattr(self, "_scene", None):
            self._release(self._scene)

    def closest(self, o: NDArray[np.float32], d: NDArray[np.float32], t: NDArray[np.float32]) -> Met:
        """See Accelerator."""
        met = _nothing(len(t))
        _closest(*self.closest_for_kernels, o, d, t, *met)
        return met

    def occluded(self, o: NDArray[np.float32], d: NDArray[np.float32], t: NDArray[np.float32]) -> NDArray[np.bool_]:
        """See Accelerator."""
        blocked = np.empty(len(t), np.bool_)
        _occluded(*self._for_occluded, o, d, t, blocked)
        return blocked

    def closest_of(self, *rays: Any) -> Met:
        """See Accelerator."""
        met = _nothing(len(rays[3]))
        _closest_of(*self.closest_for_kernels, *rays, *met)
        return met

    def closest_of_pixels(self, *rays: Any) -> Met:
        """See Accelerator."""
        met = _nothing(len(rays[0]))
        _closest_of_pixels(*self._for_pixels, *rays, *met)
        return met

    def around(self, *rays: Any) -> Met:
        """See Accelerator."""
        *_, P, _, _, local = rays
        met = _nothing(len(P) * len(local))
        _around(*self.closest_for_kernels, *rays, *met)
        return met

    def occluded_of(self, *segments: Any) -> NDArray[np.bool_]:
        """See Accelerator."""
        blocked = np.empty(len(segments[5]), np.bool_)
        _occluded_of(*self._for_occluded, *segments, blocked)
        return blocked


class Device(NamedTuple):
    """Embree's library, a device of it, and where the functions that kernels call stand in memory."""

    library: ctypes.CDLL
    address: int
    closest: int
    packets: int  # the same as `closest` for 8 rays at once
    occluded: tuple[int, int]  # and for how many rays at once


_making = threading.Lock()


def _device() -> Device | None:
    with _making:
        return _made()


@functools.cache
def _made() -> Device | None:
    """Return the device of this process, which lives as long as it; None where there is none that embree.c can use."""
    if os.environ.get("LIGHT_MESHES_EMBREE") == "run":
        return None
    for path in _libraries():
        try:
            library = ctypes.CDLL(str(path))  # it is loaded already: embreex has done so
            _declare(library)
            address = library.rtcNewDevice(f"threads={processors.count()}".encode())
            if not address or library.rtcGetDeviceProperty(address, _MAJOR) != VERSION:
                continue
            wide = 16 if library.rtcGetDeviceProperty(address, _NATIVE_16) else 8
            return Device(library, address, _address(library.rtcIntersect1), _address(library.rtcIntersect8),
                          (_address(getattr(library, f"rtcOccluded{wide}")), wide))
        except (OSError, AttributeError):  # no such library, or no such function in it
            continue
    return None


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def _libraries() -> list[Path]:
    """Return where wheels of the three systems keep Embree's library."""
    package = Path(embreex.__file__).parent
    name = {"win32": "*embree4*.dll", "darwin": "*embree4*.dylib"}.get(sys.platform, "*embree4*.so*")
    return [path for folder in (package.parent / "embreex.libs", package / ".dylibs", package)
            for path in sorted(folder.glob(name))]


def _declare(library: ctypes.CDLL) -> None:
    """Declare the C types of the functions that are called from here."""
    pointer, number, size = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
    for name, result, *takes in (
        ("rtcNewDevice", pointer, ctypes.c_char_p), ("rtcGetDeviceProperty", ctypes.c_ssize_t, pointer, number),
        ("rtcGetDeviceError", number, pointer), ("rtcNewScene", pointer, pointer), ("rtcReleaseScene", None, pointer),
        ("rtcSetSceneFlags", None, pointer, number), ("rtcCommitScene", None, pointer),
        ("rtcNewGeometry", pointer, pointer, number), ("rtcCommitGeometry", None, pointer),
        ("rtcReleaseGeometry", None, pointer), ("rtcAttachGeometry", number, pointer, pointer),
        ("rtcSetSharedGeometryBuffer", None, pointer, number, number, number, pointer, size, size, size),
        ("rtcSetNewGeometryBuffer", pointer, pointer, number, number, number, size, size),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, takes


def room_for(n: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return arrays for n ready-made rays: o, d and t."""
    return np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
