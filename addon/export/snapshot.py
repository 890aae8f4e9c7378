"""Write the snapshot folder: scene.json and one .npy file for each array, as the engine's `snapshot` module reads
it.
"""

import json
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .report import ExportError

FORMAT = "light-meshes snapshot"
VERSION = 1


@contextmanager
def handing_over():
    """Turn the error of a file that cannot be written into an ExportError."""
    try:
        yield
    except OSError as e:
        reason = e.strerror or "the disk is full"  # numpy does not say why it wrote less
        where = f" ({e.filename})" if e.filename else ""
        raise ExportError(f"The scene cannot be handed to the Light Meshes engine: {reason}{where}") from e


def write(folder: Path, arrays: dict[str, np.ndarray], description: dict) -> None:
    """Write a snapshot into `folder`. scene.json is written last: if it exists, the snapshot is complete."""
    write_arrays(folder, arrays)
    write_description(folder / "scene.json", description)


def write_arrays(folder: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write one file for each array."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)


def write_description(path: Path, description: dict) -> None:
    """Write the part that is not arrays, as JSON."""
    data = {"format": FORMAT, "version": VERSION} | description
    path.write_text(json.dumps(data), encoding="utf-8")
