"""Convert image textures to files that the engine can read."""

import contextlib
import os
import struct
from pathlib import Path

import bpy
import numpy as np

from . import color
from .image_files import engine_reads, path_of, refusal
from .report import Report

_SAVES_COPIES = "save_copy" in bpy.types.Image.bl_rna.functions["save"].parameters
_INTERPOLATION = {'Closest': 'CLOSEST', 'Cubic': 'CUBIC', 'Smart': 'CUBIC'}  # as Cycles on a processor
_MISSING = 0, 0  # in place of an image's number and tile, of which none is 0
_PNG_END = b"IEND\xaeB\x60\x82"


class Images:
    """The images of a snapshot, each once."""

    def __init__(self, folder: Path) -> None:
        self.descriptions: list[dict] = []
        self.frame = 0  # of the scene
        self.moves = False  # whether an image shows another picture at another frame
        self._folder = folder
        self._indices: dict[tuple, int] = {}
        self._written: dict[tuple[int, int], dict] = {}  # files of images, by tile, that Blender alone has
        self._files = 0

    def clear(self, repainted: bool) -> None:
        """Start again. Files that were written stay valid, unless images were `repainted`."""
        self.descriptions, self._indices, self.moves = [], {}, False
        if repainted:
            self._written = {}

    def forget_files(self, names: set[str]) -> None:
        """Forget these files, which were removed."""
        self._written = {uid: file for uid, file in self._written.items() if file["path"] not in names}

    def index(self, node, report: Report, tile: int = 0) -> int:
        """Return number of the image of an image texture node, as the node shows it. One that cannot be had is magenta,
        as in Cycles.

        tile: the number of a UDIM tile, 0 for the first, or for images without tiles; −1 is returned for a tile that
        cannot be had.
        """
        self._report = report
        image = node.image
        self.moves |= image.source == 'SEQUENCE'
        try:
            path = path_of(image, node.image_user, self.frame, tile)
        except ValueError:  # a NUL
            path = Path(image.filepath.replace("\0", "?"))
        linked = "Alpha" in node.outputs and node.outputs["Alpha"].is_linked
        extension = getattr(node, "extension", 'REPEAT')  # an environment has none
        key = (image.original.session_uid, node.interpolation, extension, linked, path, tile)
        if key not in self._indices:
            file = self._file(image, path, tile) or (None if tile else self._missing())
            if file is None:
                self._indices[key] = -1
            else:
                self._indices[key] = len(self.descriptions)
                self.descriptions.append({
                    "name": image.name, "interpolation": _INTERPOLATION.get(node.interpolation, 'LINEAR'),
                    "extension": extension,
                } | color.space(image.colorspace_settings) | _alpha(image, linked) | file)
        return self._indices[key]

    def _file(self, image, path: Path, tile: int) -> dict | None:
        """Return a file with the image's pixels, and what else is special about it."""
        if image.source == 'MOVIE':
            self._warn(image, "movies are not translated; its first frame is used")
        original = image.original
        known = original.session_uid, tile
        if known in self._written and not original.is_dirty:
            return self._written[known]
        packed = _packed(original, path if tile else None)
        if image.source in {'FILE', 'SEQUENCE', 'TILED', 'MOVIE'} and not original.is_dirty and not packed:
            refused = refusal(path)
            # an image that Blender has read already stays available
            if refused and not (image.source == 'FILE' and original.has_data):
                self._warn(image, f"its file {str(path)!r} {refused}; it is shown magenta, like in Cycles")
                return None
            if not refused and image.source != 'MOVIE' and engine_reads(path):
                return {"path": str(path.resolve())}
        if tile and not packed and tile != image.tiles[0].number:
            self._warn(image, f"its tile {tile} is in no file; it is shown as missing: save the image")
            return None
        name = f"image-{self._files}"
        if packed and not original.is_dirty:
            written = self._unpacked(packed, f"{name}{Path(image.filepath).suffix[:8]}")
        else:
            written = self._saved(original, f"{name}.png")
        written = written or self._pixels(image, f"{name}.tif")
        if written:
            self._files += 1
            self._written[known] = written
        return written

    def _missing(self) -> dict:
        """Return a file with one magenta texel, which stands for an image that cannot be had."""
        file = self._written.get(_MISSING)
        if file is None:
            self._folder.mkdir(parents=True, exist_ok=True)
            write_tiff(self._folder / "image-missing.tif", np.array([[[255, 0, 255, 255]]], np.uint8))
            file = self._written[_MISSING] = {"path": "image-missing.tif"}
        return file

    def _unpacked(self, data: bytes, name: str) -> dict | None:
        """Write a file that was packed into the .blend, unchanged. Returns None if the engine could not read it."""
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / name
        path.write_bytes(data)
        if engine_reads(path):
            return {"path": name}
        path.unlink()
        return None

    def _saved(self, original, name: str) -> dict | None:
        """Return the bytes that Blender has, saved by itself; None where that would not be all of them.

        Pixels that Python asks for are floats: four times the memory of the image.
        """
        space = original.colorspace_settings
        as_they_are = space.is_data or space.name == "sRGB"  # all others are converted to sRGB
        whole = original.depth == 32 or not original.is_dirty  # who paints may make even others transparent
        if (_SAVES_COPIES and original.source in {'FILE', 'GENERATED'} and original.file_format == 'PNG'
                and not original.is_float and as_they_are and whole):
            self._folder.mkdir(parents=True, exist_ok=True)
            path = self._folder / name
            with contextlib.suppress(RuntimeError, OSError):  # there is another way, which tells why
                original.save(filepath=str(path), save_copy=True)
                with path.open("rb") as f:
                    f.seek(-len(_PNG_END), os.SEEK_END)
                    if f.read() == _PNG_END:  # on a full disk it is half a picture
                        return {"path": name}
            path.unlink(missing_ok=True)
        return None

    def _pixels(self, image, name: str) -> dict | None:
        """Write a file with the pixels that Blender has in memory."""
        original = image.original
        had = original.has_data
        size = tuple(original.size)
        if not all(size) or original.channels == 0:
            self._warn(image, f"its file {image.filepath!r} cannot be read; it is shown magenta, like in Cycles")
            return None
        pixels = np.empty(size[0] * size[1] * original.channels, np.float32)
        original.pixels.foreach_get(pixels)
        if not original.is_float:
            pixels *= 255
            pixels = np.rint(pixels, out=pixels).astype(np.uint8)
        if not had and not original.is_dirty and image.source != 'GENERATED':
            original.buffers_free()  # free the pixels, as nobody used them before
        self._folder.mkdir(parents=True, exist_ok=True)
        write_tiff(self._folder / name, pixels.reshape(size[1], size[0], -1)[::-1])
        # Blender stores float pixels in the scene's linear light, premultiplied; byte pixels are as in the file.
        return {"path": name} | ({"colorspace": 'LINEAR', "matrix": color.IDENTITY} if original.is_float else {})

    def _warn(self, image, sentence: str) -> None:
        self._report.warn(sentence, "Image", image.name)


def _packed(image, tile: Path | None) -> bytes:
    """Return the file of an image that is packed into the .blend, of several the first, or that of a tile; empty where
    none is.
    """
    if image.source not in {'FILE', 'TILED'}:
        return b""
    if tile:
        named = [p.packed_file for p in image.packed_files if Path(p.filepath.replace("\\", "/")).name == tile.name]
        return named[0].data if named and named[0] and named[0].size else b""
    packed = image.packed_file or (image.packed_files[0].packed_file if image.packed_files else None)
    return packed.data if packed and packed.size else b""


def _alpha(image, linked: bool) -> dict:
    """Return how alpha changes the colours, as in Cycles. `linked`: whether the Alpha output of the node is used."""
    if image.alpha_mode == 'NONE':
        return {"alpha": 'IGNORED'}
    if image.colorspace_settings.is_data or image.alpha_mode == 'CHANNEL_PACKED':
        return {"alpha": 'KEEP'}
    # Up to 5.1 Cycles decides by the file; later versions decide by the alpha mode.
    stored = {'STRAIGHT': 'STRAIGHT', 'PREMUL': 'MULTIPLIED'}[image.alpha_mode]
    return {"alpha": 'STRAIGHT' if linked else 'MULTIPLIED', "stored": stored if bpy.app.version >= (5, 2) else 'FILE'}


def write_tiff(path: Path, pixels: np.ndarray) -> None:
    """Write RGB(A) pixels, float32 or uint8, top row first, as a minimal TIFF file without the help of a library.

    Floats must be premultiplied by alpha, bytes must not.
    """
    if pixels.shape[2] < 3:
        pixels = pixels[:, :, :1].repeat(3, axis=2)
    height, width, channels = pixels.shape
    is_float = pixels.dtype != np.uint8
    data = np.ascontiguousarray(pixels, "<f4" if is_float else np.uint8).data
    # tag, type (3: 16 bit, 4: 32 bit), count, value; entries of three values are stored after the directory
    entries = [(256, 4, 1, width), (257, 4, 1, height), (258, 3, channels, None), (259, 3, 1, 1), (262, 3, 1, 2),
               (273, 4, 1, None), (277, 3, 1, channels), (278, 4, 1, height), (279, 4, 1, data.nbytes),
               # the fourth channel is alpha, premultiplied
               *([(338, 3, 1, 1 if is_float else 2)] if channels == 4 else []),
               (339, 3, channels, None)]
    after = 8 + 2 + 12 * len(entries) + 4
    values = {258: after, 339: after + 2 * channels, 273: after + 4 * channels}
    with path.open("wb") as f:
        f.write(struct.pack("<2sHIH", b"II", 42, 8, len(entries)))
        for tag, kind, count, value in entries:
            f.write(struct.pack("<HHII", tag, kind, count, values[tag] if value is None else value))
        bits, kind = (32, 3) if is_float else (8, 1)
        f.write(struct.pack(f"<I{2 * channels}H", 0, *[bits] * channels, *[kind] * channels))
        f.write(data)
