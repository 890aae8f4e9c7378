"""Image textures: read by OpenImageIO, looked up in linear light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from .compiled import kernel
from .scene import Image, SceneError

_EXTENSIONS = ("REPEAT", "EXTEND", "CLIP", "MIRROR")


class Texture:
    """One image: texels as the file has them (8 bits or float32) and the way to linear light."""

    def __init__(self, image: Image) -> None:
        self.key = _key(image)
        if not Path(image.path).is_file():  # a pipe, say, would keep us waiting
            raise OSError("there is no such file")
        straight = oiio.ImageSpec()  # colours as painted, not multiplied by alpha
        straight.attribute("oiio:UnassociatedAlpha", 1)
        source = oiio.ImageInput.open(image.path, straight)
        if source is None:
            raise OSError(oiio.geterror() or "cannot be opened")
        try:
            kind = oiio.UINT8 if source.spec().format == oiio.UINT8 else oiio.FLOAT
            texels = source.read_image(0, 0, 0, source.spec().nchannels, kind)
            if texels is None:
                raise OSError(source.geterror() or "cannot be read")
        finally:
            source.close()
        texels = np.atleast_3d(texels)
        has_alpha = texels.shape[2] in (2, 4)
        self._alpha = np.ascontiguousarray(texels[:, :, -1:]) if has_alpha else None
        texels = texels[:, :, :3] if texels.shape[2] >= 3 else np.repeat(texels[:, :, :1], 3, axis=2)  # grey
        self._straight = np.linspace(0, 1, 256, dtype=np.float32)
        self._linear = self._straight
        if image.colorspace == "sRGB":
            self._linear = _srgb_to_linear(self._linear)
            if texels.dtype != np.uint8:
                texels = _srgb_to_linear(texels)
        self._texels = np.ascontiguousarray(texels)
        self._closest = image.interpolation == "CLOSEST"
        self._extension = _EXTENSIONS.index(image.extension)

    def lookup(self, uv: NDArray[np.float32], rows: NDArray[np.int64], colour: NDArray[np.float64]) -> None:
        """colour[rows] = the texture at uv[rows]; v points up."""
        _lookup(self._texels, self._texels.dtype == np.uint8, self._linear, self._closest, self._extension, uv, rows,
                colour)

    def alpha(self, uv: NDArray[np.float32]) -> NDArray[np.float64]:
        """Its alpha (n,) at uv (n,2); 1 where it has none."""
        alpha = np.ones((len(uv), 1))
        if self._alpha is not None:
            _lookup(self._alpha, self._alpha.dtype == np.uint8, self._straight, self._closest, self._extension, uv,
                    np.arange(len(uv)), alpha)
        return alpha[:, 0]


def load(images: tuple[Image, ...], old: Sequence[Texture | None] = ()) -> tuple[list[Texture | None], list[str]]:
    """Textures, None with a sentence for those that cannot be read. Those of `old` are used again where they can."""
    textures: list[Texture | None] = []
    warnings = []
    ready = {texture.key: texture for texture in old if texture}
    for image in images:
        try:
            textures.append(ready.get(_key(image)) or Texture(image))
        except OSError as e:
            textures.append(None)
            warnings.append(f"image '{image.name}' ({image.path}) cannot be read, the surfaces keep their plain "
                            f"colour: {' '.join(str(e).split()) or 'unknown reason'}")
        except MemoryError as e:
            raise SceneError(f"image '{image.name}' ({image.path}) needs more memory than there is") from e
    return textures, warnings


def _key(image: Image) -> tuple:
    """What a texture depends on."""
    try:
        file = Path(image.path).stat()
    except (OSError, ValueError):  # reading it will say what is wrong, if anything
        return (object(),)  # equal to no other
    return replace(image, name=""), file.st_mtime_ns, file.st_size


def _srgb_to_linear(x: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0) + 0.055) / 1.055) ** 2.4).astype(np.float32)


@kernel
def _wrap(x, size, extension):
    """Texel index of x, or −1 outside a clipped image."""
    if extension == 0:
        return x % size
    if extension == 3:
        x %= 2 * size
        return x if x < size else 2 * size - 1 - x
    if extension == 2 and (x < 0 or x >= size):
        return -1
    return min(max(x, 0), size - 1)


@kernel
def _lookup(texels, coded, linear, closest, extension, uv, rows, colour):
    """coded: texels are 8-bit indices into `linear`; otherwise they are linear themselves."""
    height, width = texels.shape[0], texels.shape[1]
    for row in rows:
        x, y = np.float64(uv[row, 0]) * width, (1.0 - np.float64(uv[row, 1])) * height
        if not (abs(x) < 1e9 and abs(y) < 1e9):
            x, y = 0.0, 0.0
        if closest:
            x, y = np.floor(x), np.floor(y)
        else:
            x, y = x - 0.5, y - 0.5
        x0, y0 = int(np.floor(x)), int(np.floor(y))
        fx, fy = x - x0, y - y0
        for c in range(colour.shape[1]):
            colour[row, c] = 0.0
        for corner in range(4):
            dx, dy = corner & 1, corner >> 1
            weight = (fx if dx else 1.0 - fx) * (fy if dy else 1.0 - fy)
            if weight == 0.0:
                continue
            i, j = _wrap(x0 + dx, width, extension), _wrap(y0 + dy, height, extension)
            if i < 0 or j < 0:
                continue
            for c in range(colour.shape[1]):
                t = texels[j, i, c]
                colour[row, c] += weight * (linear[int(t)] if coded else t)
