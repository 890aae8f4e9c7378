"""The snapshot folder: scene.json and one .npy an array, as the engine's `snapshot` module reads it."""

import json
from pathlib import Path

import numpy as np

FORMAT = "light-meshes snapshot"
VERSION = 1


def write(folder: Path, arrays: dict[str, np.ndarray], description: dict) -> None:
    """Write into `folder`. scene.json comes last: with it, all is there."""
    write_arrays(folder, arrays)
    write_description(folder / "scene.json", description)


def write_arrays(folder: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write one file an array."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)


def write_description(path: Path, description: dict) -> None:
    """Write what is no array."""
    data = {"format": FORMAT, "version": VERSION} | description
    path.write_text(json.dumps(data), encoding="utf-8")
