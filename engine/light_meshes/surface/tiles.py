"""Tiles of images that do not fit into memory together. OpenImageIO's cache, which has a limit, reads and keeps them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scene.errors import SceneError
from ..support.oiio import oiio

TILE = 256  # texels along a side of a tile, of files that have none
OPEN = 64  # files at most


class Cache:
    """OpenImageIO's cache of tiles of all files of a scene, which holds `limit` bytes at most."""

    def __init__(self, limit: int) -> None:
        self._cache = oiio.ImageCache(False)
        for name, value in (("max_memory_MB", float(limit / 2**20)), ("autotile", TILE), ("autoscanline", 0),
                            ("max_open_files", OPEN), ("unassociatedalpha", 1), ("automip", 0)):
            self._cache.attribute(name, value)

    @property
    def bytes(self) -> int:
        """Return how many bytes of texels it holds now."""
        return int(self._cache.getattribute("stat:cache_memory_used"))

    def read(self, path: str, x: int, y: int, width: int, height: int, kind: Any) -> NDArray:
        """Return the texels (height,width,channels) of a file from column x and row y on. Raises OSError."""
        found = self._cache.get_pixels(path, 0, 0, x, x + width, y, y + height, 0, 1, kind)
        if found is None:
            raise OSError(self._cache.geterror() or "cannot be read")
        return np.asarray(found).reshape(height, width, -1)


class Tiles:
    """The texels of one image, which are read when they are needed."""

    def __init__(self, cache: Cache, path: str, size: tuple[int, int], channels: int, kind: Any,
                 change: Callable[[NDArray], NDArray]) -> None:
        """size: width and height in pixels. channels: how many are wanted. kind: numpy's type of the numbers.
        change(texels (h,w,c)): the function that converts the file's texels.
        """
        self.cache, self._path, self._size, self._channels, self._change = cache, path, size, channels, change
        self._kind, self._stored = np.dtype(kind), {np.uint8: oiio.UINT8, np.uint16: oiio.UINT16}.get(kind, oiio.FLOAT)
        self._tile(0, 0)  # what cannot be read is said now

    def texels(self, index: NDArray[np.int64]) -> NDArray:
        """Return the texels (n,1,channels) at index (n,), row · width + column; 0 where the index is below 0."""
        width, _ = self._size
        out = np.zeros((len(index), 1, self._channels), self._kind)
        y, x = np.divmod(index, width)
        across = -(-width // TILE)
        tile = np.where(index >= 0, y // TILE * across + x // TILE, -1)
        order = np.argsort(tile, kind="stable")
        found, first = np.unique(tile[order], return_index=True)
        parts = np.split(order, first[1:])[:len(found)]
        for number, rows in zip(found.tolist(), parts, strict=True):
            if number >= 0:
                row, column = divmod(number, across)
                out[rows, 0] = self._tile(column, row)[y[rows] - row * TILE, x[rows] - column * TILE]
        return out

    def _tile(self, column: int, row: int) -> NDArray:
        x, y = column * TILE, row * TILE
        width, height = (min(TILE, size - at) for size, at in zip(self._size, (x, y), strict=True))
        try:
            found = self.cache.read(self._path, x, y, width, height, self._stored)
        except OSError as e:
            raise SceneError(f"the image {self._path} cannot be read any more: {e}") from e
        return self._change(np.ascontiguousarray(found[:, :, :self._channels]))
