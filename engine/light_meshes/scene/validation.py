"""Checks a scene that a Python program made in the same way as one from a snapshot: the same bounds, the same
sentences.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from .arrays import ARRAYS, fits, shape_of
from .description import IDENTITY, Camera, Image, Light, Material, Object, Scene, Settings
from .errors import SceneError
from .geometry import Geometry
from .profile import Profile
from .programs import Program, plain, program
from .snapshot import built, camera, check, checked_value, profiles

_MANY = {"lights": Light, "materials": Material, "images": Image, "objects": Object}
_ONE = {"camera": Camera, "geometry": Geometry, "settings": Settings}


def checked(scene: Scene) -> Scene:
    """Return `scene` with all values in their types: lists and arrays become tuples where the description has tuples.

    Use it before a scene that did not come from `snapshot.read` is rendered or written. Raises SceneError if a value, a
    shape, a type or an index is wrong. The values of vertices are not checked.
    """
    _check_kind(scene, Scene, "what is rendered")
    for name, kind in _ONE.items():
        _check_kind(getattr(scene, name), kind, f"scene: {name}")
    _check_arrays(scene.geometry)
    many: dict[str, Any] = {}
    for name, kind in _MANY.items():
        items = getattr(scene, name)
        if not isinstance(items, list | tuple):
            raise SceneError(f"scene: {name} must be of type tuple, not {type(items).__name__}")
        where = [f"{name[:-1]} {n}" for n in range(len(items))]
        for item, place in zip(items, where, strict=True):
            _check_kind(item, kind, place)
        many[name] = tuple(built(kind, _values(item), place) for item, place in zip(items, where, strict=True))
    one = {name: checked_value(Scene, name, default, _plain(getattr(scene, name)), "scene")
           for name, default in (("world_color", (0.0, 0.0, 0.0)), ("to_rec709", IDENTITY))}
    for n, item in enumerate(scene.profiles):
        _check_kind(item, Profile, f"profile {n}")
    many["profiles"] = profiles([_values(item) for item in scene.profiles])
    _check_kind(scene.world, Program, "scene: world")
    one["world"] = program(plain(scene.world), "world")
    made = dataclasses.replace(scene, camera=camera(_values(scene.camera)), warnings=tuple(scene.warnings),
                               settings=built(Settings, _values(scene.settings), "settings"), **many, **one)
    check(made)
    return made


def _check_kind(item: Any, kind: type, where: str) -> None:
    if not isinstance(item, kind):
        raise SceneError(f"{where} must be of type {kind.__name__}, not {type(item).__name__}")


def _check_arrays(geometry: Geometry) -> None:
    """Raise SceneError unless all arrays have the types and shapes that kernels take."""
    for name, (dtype, tail) in ARRAYS.items():
        array = getattr(geometry, name)
        _check_kind(array, np.ndarray, f"geometry: {name}")
        if array.dtype != np.dtype(dtype) or not fits(array.shape, tail):
            raise SceneError(f"geometry: {name} is {array.dtype} {array.shape}; needed: {dtype} ({shape_of(tail)}), as "
                             "Geometry.from_meshes makes it")


def _values(item: Any) -> dict[str, Any]:
    """Return the fields of a dataclass, by their names."""
    return {f.name: _plain(getattr(item, f.name)) for f in dataclasses.fields(item)}


def _plain(value: Any) -> Any:
    """Return `value` without numpy's types; a program becomes what a snapshot holds."""
    if isinstance(value, Program):
        return plain(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Material):
        return _values(value)
    return [_plain(v) for v in value] if isinstance(value, list | tuple) else value
