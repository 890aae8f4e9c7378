"""Image textures: read by OpenImageIO, and looked up in linear light."""

from __future__ import annotations

import hashlib
import stat
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.description import COLORSPACES, IDENTITY, Image, Scene
from ..scene.errors import SceneError
from ..support.native import kernel
from ..support.oiio import oiio
from .tiles import Cache, Tiles

_EXTENSIONS = ("REPEAT", "EXTEND", "CLIP", "MIRROR")  # as in textures.c
_INTERPOLATIONS = ("LINEAR", "CLOSEST", "CUBIC")
_LOOK = {np.dtype(kind): kernel(f"textures_look_{name}")
         for kind, name in ((np.uint8, "u8"), (np.uint16, "u16"), (np.float32, "f32"))}
_OPAQUE, _CLIPPED, _ASKED = 0, 1, 5  # as in texels.h
_TEXELS = {np.dtype(np.uint8): 2, np.dtype(np.uint16): 3, np.dtype(np.float32): 4}
_coverage, _needed = kernel("textures_coverage"), kernel("textures_needed")
_SYSTEM = ("/proc", "/sys", "/dev")  # files there are not real files
LIMIT = 2 << 30  # bytes of all images' texels in memory; beyond that OpenImageIO's cache has them, and holds so many
SMALL = 1 << 20  # bytes of an image that is read as a whole in any case
MISSING = (1.0, 0.0, 1.0)  # of an image that cannot be read, as Blender shows it
_STRIP = 1 << 18  # texels that are changed at once, if that is cheap
_CONVERTED = 1 << 22  # texels at once, because each call of OpenColorIO has a large fixed cost


class Layout(NamedTuple):
    """How the pixels of a file are stored."""

    width: int
    height: int
    kind: Any  # type of its numbers: np.uint8, np.uint16, np.float32
    first: int  # first channel of the colours
    colours: int  # number of their channels: 3, or 1 for a grey image
    alpha: int  # channel of alpha; -1 if it has none, or if it is not needed
    straight: bool  # colours are not multiplied by alpha
    divided: bool  # colours must be divided by alpha before they are converted

    @property
    def channels(self) -> int:
        """Return how many channels are read."""
        return max(self.first + self.colours, self.alpha + 1)

    @property
    def bytes(self) -> int:
        """Return how many bytes the texels need."""
        return self.width * self.height * self.channels * np.dtype(self.kind).itemsize


class Texture:
    """One image: its texels as in the file (8 or 16 bits, or float32), and the conversion to linear light."""

    def __init__(self, image: Image, alpha: bool = True, cache: Cache | None = None, key: tuple | None = None) -> None:
        """`alpha`: whether its alpha is needed. cache: from which its texels come when they are needed; None: they are
        read now. key: its key, if it is known; see `_key`.
        """
        self.file, self.key = _file_key(image, alpha), key or _key(image, alpha, cache)
        with _opened(image) as source:
            layout = _layout(image, source, alpha)
            texels = None if cache else _read(source, layout)
        self.width, self._height, self._kind = layout.width, layout.height, np.dtype(layout.kind)
        self._alpha = layout.alpha if alpha and image.alpha != "IGNORED" else -1
        self._first, self._step = layout.first, min(layout.colours - 1, 1)
        self._interpolation = _INTERPOLATIONS.index(image.interpolation)
        self._extension = _EXTENSIONS.index(image.extension)
        self._matrix = np.array(image.matrix, np.float64).reshape(3, 3) if image.matrix != IDENTITY else None
        most = 0 if layout.kind == np.float32 else np.iinfo(layout.kind).max
        self._straight = self._colours = np.linspace(0, 1, most + 1, dtype=np.float32)[:most and most + 1]
        self.warning = ""
        convert = None
        if image.colorspace not in COLORSPACES:
            try:
                convert = _converter(image)
            except OSError as e:
                self.warning = (f"image '{image.name}': its colour space {image.colorspace} cannot be converted to "
                                f"{image.working_space} by {image.ocio}: {e}; read as sRGB")
        seen = layout.alpha >= 0 and (texels is None or bool((texels[:, :, layout.alpha] != (most or 1)).any()))
        changes = self._associate(image, layout, most or 1, seen, convert)
        # As in Cycles sRGB is blended by its own numbers, where no other conversion must follow.
        encoded = image.colorspace != "LINEAR" and convert is None
        self._decoded = _DECODED if encoded and self._matrix is None else None
        if encoded and self._decoded is None:
            self._colours = _srgb_to_linear(self._colours)
            if not most:
                changes.append((lambda colour, alpha: _srgb_to_linear(colour), _STRIP))

        def changed(texels: NDArray) -> NDArray:
            if not most:
                texels[~np.isfinite(texels).all(2)] = 0.0  # as Cycles
            for change, strip in changes:
                _each(texels, layout, change, strip)
            return texels
        self._texels = self._tiles = None
        if texels is None:
            assert cache is not None
            self._tiles = Tiles(cache, image.path, (layout.width, layout.height), layout.channels, layout.kind, changed)
        else:
            self._texels = changed(texels)

    def _associate(self, image: Image, layout: Layout, white: int, seen: bool,
                   convert: Callable[[NDArray[np.float32]], NDArray[np.float32]] | None) -> list[tuple[_Change, int]]:
        """Decide how colours are converted, and multiplied or divided by alpha, as the image needs it. `white` is the
        value of alpha that means 1; seen: whether there may be others. Returns what is to be done to the texels, see
        `_each`, each with how many texels at once.

        As in Cycles, colours are converted without alpha; only what needs no conversion, or sRGB's own, is multiplied
        by alpha as it is in the file.
        """
        self._weight, self._weighted, self._divides = -1, False, False  # see texels.h
        has, changes = image.alpha in ("STRAIGHT", "MULTIPLIED") and seen, list[tuple[_Change, int]]()
        kept = convert is None and image.matrix == IDENTITY
        straight = layout.straight or not has
        if not straight and layout.divided:
            changes.append((lambda colour, alpha: np.divide(colour, alpha, out=colour.copy(), where=alpha != 0),
                            _STRIP))
            straight = True
        if convert:
            changes.append((lambda colour, alpha: convert(colour), _CONVERTED))
        if not has:
            return changes
        self._divides = image.alpha == "STRAIGHT"
        if kept and straight:
            changes.append(((lambda colour, alpha: colour * alpha) if white == 1 else (
                lambda colour, alpha: (colour.astype(np.uint32) * alpha // white).astype(colour.dtype)), _STRIP))
        if self._divides or (straight and not kept):
            self._weight, self._weighted = layout.alpha, kept or not straight
        return changes

    @property
    def cache(self) -> Cache | None:
        """Return the cache from which its texels come, if that is so."""
        return self._tiles.cache if self._tiles else None

    def _look(self, first: int, step: int, colours: NDArray[np.float32], weight: int, divides: bool,
              matrix: NDArray[np.float64] | None, decoded: NDArray[np.float32] | None, uv: NDArray[np.float32],
              rows: NDArray[np.int64], out: NDArray[np.float64]) -> None:
        """Set out[rows] to channels at uv[rows]: `first` and the next ones if step is 1."""
        uv, texels = np.ascontiguousarray(uv), self._texels
        if self._tiles is not None:
            index = np.empty((len(rows), 16 if self._interpolation == _INTERPOLATIONS.index("CUBIC") else 4), np.int64)
            _needed(self._height, self.width, self._interpolation, self._extension, uv, rows, index)
            texels = self._tiles.texels(index.ravel())
        _LOOK[self._kind](
            texels, self._height, self.width, self._tiles is not None, first, step, colours, weight, self._weighted,
            divides, self._straight, matrix, decoded, self._interpolation, self._extension, uv, rows, out)

    def lookup(self, uv: NDArray[np.float32], rows: NDArray[np.int64], colour: NDArray[np.float64]) -> None:
        """Set colour[rows] to the texture at uv[rows]; v points up."""
        self._look(self._first, self._step, self._colours, self._weight, self._divides, self._matrix, self._decoded, uv,
                   rows, colour)

    def alpha(self, uv: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return its alpha (n,) at uv (n,2). One that has none is opaque, and as Cycles has it, a coloured one that is
        clipped is nothing outside.
        """
        alpha = np.ones((len(uv), 1))
        if self._alpha < 0 and self._step and self._extension == _EXTENSIONS.index("CLIP"):
            _coverage(self._height, self.width, self._interpolation, np.ascontiguousarray(uv), alpha)
        elif self._alpha >= 0:
            self._look(self._alpha, 0, self._straight, -1, False, None, None, uv, np.arange(len(uv)), alpha)
        return alpha[:, 0]


    def alpha_texels(self) -> tuple[int, ...]:
        """Return where kernels find its alpha, as texels.h has it: a kind, the address of its texels, their layout, and
        the address and the length of the table that makes their numbers alpha. The kind ASKED: `alpha` must tell.
        """
        layout = self._height, self.width, 0, self._alpha, self._interpolation, self._extension
        if self._alpha < 0:
            clipped = self._step and self._extension == _EXTENSIONS.index("CLIP")
            return (_CLIPPED if clipped else _OPAQUE, 0, *layout, 0, 0)
        if self._texels is None:
            return (_ASKED, 0, *layout, 0, 0)
        layout = *layout[:2], self._texels.shape[2], *layout[3:]
        return (_TEXELS[self._kind], self._texels.ctypes.data, *layout, self._straight.ctypes.data, len(self._straight))


_Change = Callable[[NDArray, NDArray], NDArray]  # of colours (n,w,3 or 1) and alpha (n,w,1)


def _each(texels: NDArray, layout: Layout, change: _Change, strip: int) -> None:
    """Replace all colours by change(colours, alpha), about `strip` texels at a time."""
    rows = max(1, strip // max(1, texels.shape[1]))
    of_colours = slice(layout.first, layout.first + layout.colours)
    for y in range(0, len(texels), rows):
        part = texels[y:y + rows]
        part[:, :, of_colours] = change(part[:, :, of_colours], part[:, :, max(layout.alpha, 0), None])


def _read(source: Any, layout: Layout) -> NDArray:
    """Return the texels (h,w,channels) of an open file. Raises OSError."""
    kind = {np.uint8: oiio.UINT8, np.uint16: oiio.UINT16}.get(layout.kind, oiio.FLOAT)
    texels = source.read_image(0, 0, 0, layout.channels, kind)
    if texels is None:
        raise OSError(source.geterror() or "cannot be read")
    return np.ascontiguousarray(np.atleast_3d(texels))


def alpha_images(textures: Sequence[Texture | None]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return where kernels find the alpha of textures, (n,10), see `Texture.alpha_texels`; and which of them (n,) they
    do not find. Those that cannot be read are opaque.
    """
    rows = [texture.alpha_texels() if texture else (_OPAQUE,) + 9 * (0,) for texture in textures]
    found = np.array(rows, np.int64).reshape(len(rows), 10)
    return found, found[:, 0] == _ASKED


def alphas(scene: Scene) -> set[int]:
    """Return the images whose alpha is needed."""
    return {material.alpha_image for material in scene.materials}.union(
        scene.world.images(), *(material.program.images() for material in scene.materials),
        *(light.program.images() for light in scene.lights))


def load(images: Sequence[Image], asked: Collection[int], threads: int,
         old: Sequence[Texture | None] = ()) -> tuple[list[Texture | None], list[str]]:
    """Return the textures, with None for those that cannot be read, and a sentence for each of these. Textures of `old`
    are used again if possible.

    `asked`: see `alphas`. Of more than LIMIT bytes, those that are not small are read tile by tile.
    """
    ready, known = ({of(texture): texture for texture in old if texture} for of in (
        lambda texture: texture.file, lambda texture: texture.key))
    new = any(_file_key(image, i in asked) not in ready for i, image in enumerate(images))
    sizes = {image: layout.bytes for image, layout in layouts(images, asked)} if new else {}
    caches = [texture.cache for texture in ready.values() if texture.cache]
    cache = (caches[0] if caches else Cache(LIMIT)) if sum(sizes.values()) > LIMIT else None

    def one(i: int) -> tuple[Texture | None, str]:
        image = images[i]
        try:
            tiled = cache if sizes.get(image, 0) > SMALL else None
            texture = ready.get(_file_key(image, i in asked))
            if not texture:
                key = _key(image, i in asked, tiled)
                texture = known.get(key) or Texture(image, i in asked, tiled, key)
            return texture, texture.warning
        except OSError as e:
            return None, (f"image '{image.name}' ({image.path}) cannot be read, it is shown magenta: "
                          f"{' '.join(str(e).split()) or 'unknown reason'}")
        except MemoryError as e:
            raise SceneError(f"image '{image.name}' ({image.path}) needs more memory than there is") from e

    with ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(one, range(len(images))))
    return [texture for texture, _ in found], [sentence for _, sentence in found if sentence]


def held(sizes: Collection[int]) -> int:
    """Return how many bytes are in memory of images with so many bytes of texels each."""
    return sum(sizes) if sum(sizes) <= LIMIT else LIMIT + sum(size for size in sizes if size <= SMALL)


def layouts(images: Sequence[Image], asked: Collection[int]) -> list[tuple[Image, Layout]]:
    """Return the layout of each image that can be opened. Only the beginnings of the files are read."""
    found = []
    for i, image in enumerate(images):
        try:
            with _opened(image) as source:
                found.append((image, _layout(image, source, i in asked)))
        except OSError:  # reading the file will report it
            continue
    return found


@contextmanager
def _opened(image: Image) -> Iterator[Any]:
    """Open the image's file. Raises OSError also if it is not a file on a disk, because reading a pipe, for example,
    could block.
    """
    _check_file(Path(image.path))
    asked = oiio.ImageSpec()  # colours as they are stored, not multiplied by alpha
    asked.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(image.path, asked)
    if source is None:
        raise OSError(oiio.geterror() or "cannot be opened")
    try:
        yield source
    finally:
        source.close()


def _check_file(path: Path) -> None:
    try:
        path = path.resolve()
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError) as e:
        raise OSError("there is no such file") from e
    except (RuntimeError, ValueError) as e:  # a circle of links; a NUL in the name
        raise OSError("there is no such file") from e
    if not stat.S_ISREG(mode) or str(path).startswith(tuple(f"{folder}/" for folder in _SYSTEM[:2])):
        raise OSError("it is a folder" if stat.S_ISDIR(mode) else "it is no file on a disk")


def _straight(source: Any) -> bool:
    """Return whether the colours of an open file are not multiplied by alpha. As Cycles has it, what kinds of files say
    is not always so.
    """
    spec = source.spec()
    if source.format_name() == "targa":
        return spec.get_int_attribute("targa:alpha_type", -1) != 4
    return source.format_name() in ("dds", "psd") or bool(spec.get_int_attribute("oiio:UnassociatedAlpha"))


def _layout(image: Image, source: Any, alpha: bool) -> Layout:
    spec = source.spec()
    names = list(spec.channelnames)
    red = names.index("R") if "R" in names else 0
    first = red if names[red:red + 3] == ["R", "G", "B"] else 0
    colours = 3 if spec.nchannels >= 3 else 1
    of_alpha = spec.nchannels - 1 if spec.nchannels in (2, 4) else spec.alpha_channel
    if spec.nchannels > 4 and of_alpha < 0 and first == 0:
        of_alpha = 3  # as in Cycles, whatever it is
    straight = {"STRAIGHT": True, "MULTIPLIED": False}[image.stored] if image.stored != "FILE" else _straight(source)
    wanted = (alpha and image.alpha != "IGNORED") or image.alpha in ("MULTIPLIED", "STRAIGHT")
    converts = image.colorspace not in COLORSPACES
    changed = converts or (image.colorspace == "sRGB" and image.matrix != IDENTITY)
    divided = not straight and of_alpha >= 0 and changed and image.alpha in ("STRAIGHT", "MULTIPLIED")
    kind = np.float32 if converts or divided else {  # these are kept as they are
        oiio.UINT8: np.uint8, oiio.UINT16: np.uint16}.get(spec.format.basetype, np.float32)
    return Layout(spec.width, spec.height, kind, first, colours, of_alpha if wanted else -1, straight, divided)


def _converter(image: Image) -> Callable[[NDArray[np.float32]], NDArray[np.float32]]:
    """Return a function that converts colours from the image's space to the scene's linear light, by the OpenColorIO
    configuration.
    """
    _check_file(Path(image.ocio))
    file = Path(image.ocio).stat()
    missing, names = _configuration(image.ocio, file.st_mtime_ns, file.st_size)
    if not missing and not {image.colorspace, image.working_space} <= names:
        missing = "there is no such conversion"
    if missing:
        raise OSError(missing.splitlines()[-1])

    def convert(colour: NDArray[np.float32]) -> NDArray[np.float32]:
        pixels = np.ascontiguousarray(np.broadcast_to(colour, (*colour.shape[:2], 3)))
        buffer = oiio.ImageBuf(pixels)
        done = oiio.ImageBufAlgo.colorconvert(
            buffer, buffer, image.colorspace, image.working_space, False, "", "", image.ocio)
        if not done:
            raise OSError(buffer.geterror())
        return np.asarray(buffer.get_pixels(oiio.FLOAT))[:, :, :colour.shape[2]]

    return convert


@lru_cache(maxsize=4)
def _configuration(path: str, changed: int, size: int) -> tuple[str, frozenset[str]]:
    """Return what is wrong with a file of an OpenColorIO configuration, if anything, and the names of its colour spaces
    and roles. To read Blender's takes as long as a small image; all images have the same. changed, size: the file's.
    """
    config = oiio.ColorConfig(path)
    # an error, for example, if it was made for a later version
    return config.geterror(), frozenset([*config.getColorSpaceNames(), *config.getRoles()])


def _file_key(image: Image, alpha: bool) -> tuple:
    """Return everything on which a texture depends, if its file has not been made anew."""
    try:
        file = Path(image.path).stat()
    except (OSError, ValueError):  # reading the file will report any error
        return (object(),)  # equal to no other object
    return replace(image, name=""), alpha, file.st_mtime_ns, file.st_size


def _key(image: Image, alpha: bool, cache: Cache | None) -> tuple:
    """Return everything on which a texture depends, of one in memory by what its file contains: images that are packed
    into a .blend get a new file for each picture.
    """
    if cache:
        return _file_key(image, alpha)
    _check_file(Path(image.path))
    with Path(image.path).open("rb") as file:
        content = hashlib.file_digest(file, "blake2b").digest()
    return replace(image, name="", path=""), alpha, content


def _srgb_to_linear(x: NDArray[np.float32] | NDArray[np.float64]) -> NDArray[np.float32]:
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0) + 0.055) / 1.055) ** 2.4).astype(np.float32)


_DECODED = _srgb_to_linear(np.linspace(0, 1, 4097))  # see texels.h
