"""Passes as arrays, in memory or mapped to files, and pictures on disk (through OpenImageIO)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scene.description import IDENTITY, RGB, Scene
from ..scene.errors import SceneError
from ..support import scratch
from ..support.oiio import oiio
from .passes import letters

# From the linear light of Rec.709 to CIE XYZ.
_REC709 = np.array([(0.4123908, 0.3575843, 0.1804808), (0.2126390, 0.7151687, 0.0721923),
                    (0.0193308, 0.1191948, 0.9505322)])


@dataclass(frozen=True)
class Framebuffer:
    """One float32 array of shape (height, width, channels) for each pass. It covers the camera's crop; the bottom row
    is first.
    """

    width: int
    height: int
    passes: dict[str, NDArray[np.float32]]

    @classmethod
    def create(cls, scene: Scene, passes: Sequence[str], folder: Path | None = None) -> Framebuffer:
        """Make passes filled with zeros, in memory or, with `folder`, as files PASS.npy that another process can
        map.
        """
        x0, y0, x1, y1 = crop_of(scene)
        arrays = {}
        for name in passes:
            shape = (y1 - y0, x1 - x0, len(letters(name)))
            if folder is None:
                arrays[name] = np.zeros(shape, np.float32)
            else:
                folder.mkdir(parents=True, exist_ok=True)
                arrays[name] = _mapped(folder / f"{name}.npy", shape)
        return cls(x1 - x0, y1 - y0, arrays)

    @property
    def channels(self) -> dict[str, int]:
        """Return pass name → number of channels."""
        return {name: a.shape[2] for name, a in self.passes.items()}

    def save(self, folder: Path) -> None:
        """Write the files PASS.npy. Each file is replaced at once, so a process that still reads the old one keeps the
        old data.
        """
        folder.mkdir(parents=True, exist_ok=True)
        for name, a in self.passes.items():
            new = folder / f"{name}.new.npy"
            np.save(new, a)
            new.replace(folder / f"{name}.npy")

    def flush(self) -> None:
        """Write mapped passes out to the system. After this another process sees them complete."""
        for a in self.passes.values():
            if isinstance(a, np.memmap):
                a.flush()


def crop_of(scene: Scene) -> tuple[int, int, int, int]:
    """Return the rendered pixels: x0, y0, x1, y1."""
    return scene.camera.crop or (0, 0, scene.camera.width, scene.camera.height)


def _mapped(path: Path, shape: tuple[int, int, int]) -> NDArray[np.float32]:
    """Return a mapped file of zeros. Raises OSError if the disk is full; if that were found out only later, it would
    end the process.
    """
    array = np.lib.format.open_memmap(path, "w+", np.float32, shape)
    if hasattr(os, "posix_fallocate"):  # other systems have no files with holes, or no such call
        with path.open("r+b") as f:
            os.posix_fallocate(f.fileno(), 0, path.stat().st_size)
    return array


def write(frame: Framebuffer, path: Path, to_rec709: tuple[RGB, RGB, RGB] = IDENTITY) -> None:
    """Write .exr (all passes, scene-linear float32) or .png (Combined, sRGB "Standard" view, 8 bits).

    `to_rec709` is the scene's matrix, needed if its linear light is not that of Rec.709. The file appears only when it
    is complete. Raises SceneError if it cannot be written.
    """
    if path.suffix.lower() == ".exr":
        channels = [f"{name}.{c}" if name != "Combined" else c
                    for name in frame.passes for c in letters(name)]
        pixels = np.concatenate(list(frame.passes.values()), axis=2)
        spec = oiio.ImageSpec(frame.width, frame.height, len(channels), oiio.FLOAT)
        spec.channelnames = tuple(channels)
        spec.attribute("compression", "zip")
        if to_rec709 != IDENTITY:
            spec.attribute("chromaticities", "float[8]", chromaticities(to_rec709))
    elif path.suffix.lower() == ".png":
        pixels = frame.passes["Combined"]
        if to_rec709 != IDENTITY:
            pixels = np.concatenate([pixels[..., :3] @ np.array(to_rec709, np.float32).T, pixels[..., 3:]], 2)
        pixels = to_srgb(pixels)
        spec = oiio.ImageSpec(frame.width, frame.height, 4, oiio.UINT8)
    else:
        raise SceneError(f"{path.name}: pictures are written as .png or .exr")
    try:
        # In a separate place, because several machines may write the same picture. An older picture stays until this
        # one is complete.
        with scratch.made(path.parent, hidden=True) as folder:
            new = folder / f"picture{path.suffix.lower()}"
            _write_file(new, spec, pixels[::-1], path)
            new.replace(path)
    except OSError as e:  # for example, the name is too long
        raise SceneError(f"{path} cannot be written: {e.strerror}") from e


def _write_file(new: Path, spec: Any, pixels: NDArray, path: Path) -> None:
    """Write the file `new`, which will be renamed to `path`."""
    name = utf8(new)
    out = oiio.ImageOutput.create(name)
    if out is None:
        raise SceneError(f"{path} cannot be written: {oiio.geterror()}")
    done = out.open(name, spec) and out.write_image(np.ascontiguousarray(pixels)) and out.close()
    # OpenImageIO does not notice that the disk is full when it writes a small PNG; then the last chunk is missing.
    if not done or not _ends_well(new):
        raise SceneError(f"{path} cannot be written: {out.geterror() or 'is there room, and permission?'}")


def _ends_well(path: Path) -> bool:
    """Return whether a PNG has its last chunk; OpenImageIO does not notice if it is missing."""
    if path.suffix.lower() != ".png":
        return True
    with path.open("rb") as f:
        f.seek(max(0, f.seek(0, os.SEEK_END) - 12))
        return f.read().endswith(b"IEND\xae\x42\x60\x82")


def check_place(path: Path) -> None:
    """Raise SceneError before the render if no picture can be written at `path`."""
    if not path.parent.is_dir():
        raise SceneError(f"the folder {path.parent} does not exist")
    if path.is_dir():
        raise SceneError(f"{path} is a folder: remove it, or give the picture another name")
    try:
        with scratch.made(path.parent, hidden=True) as folder:
            (folder / path.name).touch()
    except OSError as e:
        raise SceneError(f"{path} cannot be written: {e.strerror}") from e


def check_channels(path: Path, passes: Sequence[str]) -> None:
    """Raise SceneError before the render if a file of this kind cannot hold so many channels."""
    count = sum(len(letters(name)) for name in passes)
    with scratch.made(path.parent, hidden=True) as folder:
        name = utf8(folder / f"picture{path.suffix.lower()}")
        out = oiio.ImageOutput.create(name)
        if out is not None and not out.open(name, oiio.ImageSpec(1, 1, count, oiio.FLOAT)):
            raise SceneError(f"{path} cannot be written: {out.geterror()}; render fewer passes")


def whole(path: Path) -> bool:
    """Return whether a complete picture exists: not an empty or truncated file, and not a folder."""
    if not path.is_file() or not _ends_well(path):
        return False
    file = oiio.ImageInput.open(utf8(path))
    if file is None:
        oiio.geterror()
        return False
    try:
        number = 0
        while file.seek_subimage(number, 0):
            spec = file.spec()
            rows = range(spec.y, spec.y + spec.height, spec.tile_height or 64)
            for y in rows:  # row by row, because the picture may be larger than the memory
                end = min(y + rows.step, rows.stop)
                pixels = file.read_tiles(number, 0, spec.x, spec.x + spec.width, y, end, spec.z, spec.z + 1, 0,
                                         spec.nchannels, spec.format) if spec.tile_width else \
                    file.read_scanlines(number, 0, y, end, spec.z, 0, spec.nchannels, spec.format)
                if pixels is None:
                    return False
            number += 1
    finally:
        file.geterror()
        file.close()
    oiio.geterror()
    return number > 0


def utf8(path: Path) -> str:
    """Return `path` in UTF-8, as OpenImageIO needs it on every system, whatever the locale. Raises SceneError."""
    try:
        return os.fsencode(path).decode()
    except UnicodeError:
        raise SceneError(f"{path} cannot be used: its name is not in UTF-8") from None


def chromaticities(to_rec709: tuple[RGB, RGB, RGB]) -> tuple[float, ...]:
    """Return x and y of red, green, blue and white, as in the header of OpenEXR."""
    xyz = _REC709 @ np.array(to_rec709)
    columns = np.column_stack([xyz, xyz.sum(1)])
    return tuple((columns[:2] / columns.sum(0)).T.ravel().tolist())


def to_srgb(pixels: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Convert premultiplied linear RGBA to 8-bit sRGB with straight alpha, as PNG needs it."""
    alpha = np.clip(pixels[..., 3:], 0, 1)
    colour = np.clip(pixels[..., :3] / np.where(alpha > 0, alpha, 1), 0, 1)
    colour = np.where(colour <= 0.0031308, 12.92 * colour, 1.055 * colour ** (1 / 2.4) - 0.055)
    return np.rint(np.concatenate([colour, alpha], axis=2) * 255).astype(np.uint8)
