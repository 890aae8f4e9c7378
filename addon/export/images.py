"""Image textures → files that the engine can read."""

import struct
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np

from .report import Report

# Blender's colour spaces that are plain numbers to the engine. Non-Color is used for colours too.
_LINEAR = ("Linear", "Non-Color", "Raw", "Utility - Raw", "scene_linear")


class Images:
    """The images of a snapshot, each once."""

    def __init__(self, folder: Path) -> None:
        self.descriptions: list[dict] = []
        self._folder = folder
        self._indices: dict[tuple, int] = {}
        self._written: dict[int, str] = {}  # files of images that Blender alone has
        self._files = 0

    def clear(self, repainted: bool) -> None:
        """Begin anew. Files that were written are still right unless images were `repainted`."""
        self.descriptions, self._indices = [], {}
        if repainted:
            self._written = {}

    def forget_files(self, names: set[str]) -> None:
        """These files are gone."""
        self._written = {uid: name for uid, name in self._written.items() if name not in names}

    def index(self, node, report: Report) -> int:
        """Number of the image of an image texture node, with the node's interpolation and extension."""
        self._report = report
        image = node.image
        key = (image.original.session_uid, node.interpolation, node.extension)
        if key not in self._indices:
            if node.projection != 'FLAT':
                self._warn(image, f"its {node.projection.lower()} projection is not translated; the UV map places it")
            path = self._path(image)
            if path is None:
                self._indices[key] = -1
            else:
                self._indices[key] = len(self.descriptions)
                self.descriptions.append({
                    "name": image.name, "path": path, "colorspace": self._colorspace(image),
                    "interpolation": 'CLOSEST' if node.interpolation == 'Closest' else 'LINEAR',
                    "extension": node.extension,
                })
        return self._indices[key]

    def _colorspace(self, image) -> str:
        name = image.colorspace_settings.name
        if name == 'sRGB':
            return 'sRGB'
        if not name.startswith(_LINEAR):
            self._warn(image, f"its colour space {name} is not translated; read as sRGB")
            return 'sRGB'
        return 'LINEAR'

    def _path(self, image) -> str | None:
        """A file with the image's pixels; where Blender alone has them, one in the snapshot's folder."""
        if image.source in {'MOVIE', 'SEQUENCE'}:
            self._warn(image, "movies and image sequences are not translated; the frame that Blender shows is used")
        elif image.source == 'TILED':
            self._warn(image, "UDIM tiles are not translated; the first tile is used everywhere")
        elif image.source == 'FILE' and not image.packed_file and not image.is_dirty:
            with suppress(OSError, RuntimeError):  # a name that is too long, a folder that is closed to us
                path = Path(bpy.path.abspath(image.filepath, library=image.library)).resolve()
                if path.is_file():
                    return str(path)
        original = image.original
        if original.session_uid in self._written and not original.is_dirty:
            return self._written[original.session_uid]
        size = tuple(original.size)
        if not all(size) or original.channels == 0:
            self._warn(image, f"its file {image.filepath!r} cannot be read; the surface has a plain colour")
            return None
        name = f"image-{self._files}.tif"
        pixels = np.empty(size[0] * size[1] * original.channels, np.float32)
        original.pixels.foreach_get(pixels)
        self._folder.mkdir(parents=True, exist_ok=True)
        write_tiff(self._folder / name, pixels.reshape(size[1], size[0], -1)[::-1])
        self._files += 1
        self._written[original.session_uid] = name
        return name

    def _warn(self, image, sentence: str) -> None:
        self._report.warn(sentence, "Image", image.name)


def write_tiff(path: Path, pixels: np.ndarray) -> None:
    """Write float RGB(A) pixels, top row first, as the plainest TIFF: the one float format that needs no library."""
    if pixels.shape[2] < 3:
        pixels = pixels[:, :, :1].repeat(3, axis=2)
    height, width, channels = pixels.shape
    data = np.ascontiguousarray(pixels, "<f4").tobytes()
    # tag, type (3: 16 bit, 4: 32 bit), count, value; those of three values follow the directory.
    entries = [(256, 4, 1, width), (257, 4, 1, height), (258, 3, channels, None), (259, 3, 1, 1), (262, 3, 1, 2),
               (273, 4, 1, None), (277, 3, 1, channels), (278, 4, 1, height), (279, 4, 1, len(data)),
               *([(338, 3, 1, 2)] if channels == 4 else []),  # the fourth is alpha, not multiplied in
               (339, 3, channels, None)]
    after = 8 + 2 + 12 * len(entries) + 4
    values = {258: after, 339: after + 2 * channels, 273: after + 4 * channels}
    with path.open("wb") as f:
        f.write(struct.pack("<2sHIH", b"II", 42, 8, len(entries)))
        for tag, kind, count, value in entries:
            f.write(struct.pack("<HHII", tag, kind, count, values[tag] if value is None else value))
        f.write(struct.pack(f"<I{2 * channels}H", 0, *[32] * channels, *[3] * channels))
        f.write(data)
