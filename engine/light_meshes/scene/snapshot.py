"""A scene as a folder: `scene.json` and one `.npy` file for each array, so that it can be kept, sent and rendered
again.

The folder is not trusted: everything is checked here, once, and a `SceneError` says what is wrong and where. Writer and
reader both use the list of fields in `description.py`; the add-on writes the same layout with its own code. `arrays.py`
says where the arrays are. One folder may hold several scene files that share arrays.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..support.text import quoted
from . import programs
from .arrays import ARRAYS, check_geometry, read_geometry
from .bounds import CHOICES, LARGEST, RANGES, SAMPLES
from .description import COLORSPACES, IDENTITY, Camera, Image, Light, Material, Object, Scene, Settings, names_of
from .errors import SceneError
from .profile import Profile, profile
from .values import bounded, typed

FORMAT = "light-meshes snapshot"
VERSION = 1


def write(scene: Scene, folder: Path) -> None:
    """Write `scene` into `folder`, which is made if necessary. scene.json is written last: if it exists, the snapshot
    is complete.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, (dtype, _) in ARRAYS.items():
        np.save(folder / f"{name}.npy", np.ascontiguousarray(getattr(scene.geometry, name), dtype))
    data: dict[str, Any] = {"format": FORMAT, "version": VERSION}
    for f in dataclasses.fields(Scene):
        value = getattr(scene, f.name)
        if f.name == "geometry":
            continue
        if isinstance(value, programs.Program):
            data[f.name] = programs.plain(value)
        elif dataclasses.is_dataclass(value):
            data[f.name] = _plain(value)
        elif value and dataclasses.is_dataclass(value[0]):
            data[f.name] = [_plain(v) for v in value]
        else:
            data[f.name] = list(value)
    (folder / "scene.json").write_text(json.dumps(data), encoding="utf-8")


def _plain(item: Any) -> dict[str, Any]:
    def plain(v: Any) -> Any:
        if isinstance(v, np.ndarray):
            return v.tolist()
        if isinstance(v, tuple) and v and isinstance(v[0], Material):
            return [_plain(layer) for layer in v]
        return programs.plain(v) if isinstance(v, programs.Program) else v
    return {f.name: plain(getattr(item, f.name)) for f in dataclasses.fields(item)}


def scene_file(path: Path) -> Path:
    """Return the scene file of a snapshot; `path` is this file or its folder."""
    file = path / "scene.json" if path.is_dir() else path
    if file.suffix != ".json" or not file.is_file():
        raise SceneError(f"{path} is no snapshot: it has no scene.json")
    return file


def read(path: Path, mapped: bool = True) -> Scene:
    """Read and check a snapshot; `path` is its folder, or one of the scene files there. Raises SceneError.

    `mapped`: map arrays from their files where possible. Then the files must not change as long as the scene is in use.
    """
    file = scene_file(path)
    folder = file.parent
    data = _read_json(file)
    geometry = read_geometry(folder, data.get("blocks"), data.get("instances"), mapped)
    known = {f.name for f in dataclasses.fields(Scene)} - {"geometry"}
    unknown = set(data) - known - {"format", "version", "blocks", "instances"}
    if unknown:
        raise SceneError(f"scene.json has an unknown entry {quoted(min(unknown))}")
    world = checked_value(Scene, "world_color", (0.0, 0.0, 0.0), data.get("world_color", [0.0, 0.0, 0.0]), "scene.json")
    to_rec709 = checked_value(Scene, "to_rec709", IDENTITY, data.get("to_rec709", IDENTITY), "scene.json")
    warnings = data.get("warnings", [])
    if not isinstance(warnings, list) or not all(isinstance(w, str) for w in warnings):
        raise SceneError("scene.json: warnings must be a list of sentences")
    images = _many(Image, data, "images")
    for image in images:
        for path in (image.path, image.ocio):
            if ".." in Path(path).parts:
                raise SceneError(f"image {quoted(image.name)}: its path {quoted(path)} leads out of a folder by '..'; "
                                 "give it in full, or put the image into the snapshot's folder")
    scene = Scene(
        camera=camera(data.get("camera")),
        geometry=geometry,
        lights=_many(Light, data, "lights"),
        materials=_many(Material, data, "materials"),
        images=images,
        profiles=profiles(data.get("profiles", [])),
        objects=_many(Object, data, "objects"),
        world_color=world,
        world=programs.program(data["world"], "world") if "world" in data else programs.NO_PROGRAM,
        settings=built(Settings, data.get("settings", {}), "settings"),
        to_rec709=to_rec709,
        warnings=tuple(warnings),
    )
    check(scene)
    return dataclasses.replace(
        scene, images=tuple(dataclasses.replace(i, path=str(folder / i.path), ocio=i.ocio and str(folder / i.ocio))
                            for i in scene.images)
    )


def profiles(items: Any) -> tuple[Profile, ...]:
    """Return the checked profiles of a JSON list. Raises SceneError."""
    if not isinstance(items, list | tuple):
        raise SceneError("scene.json: profiles must be a list")
    return tuple(profile(item, f"profile {n}") for n, item in enumerate(items))


def camera(data: Any) -> Camera:
    """Return a checked camera from its JSON object. Raises SceneError."""
    made: Camera = built(Camera, data, "camera")
    left, right, bottom, top = made.window
    if left == right or bottom == top:
        raise SceneError("camera: the window has no area")
    if made.crop:
        x0, y0, x1, y1 = made.crop
        if not (0 <= x0 < x1 <= made.width and 0 <= y0 < y1 <= made.height):
            raise SceneError("camera: the crop lies outside the frame or is empty")
    return made


def _read_json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as e:
        raise SceneError(f"{path} cannot be read: {e}") from e
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise SceneError(f"{path} is not a Light Meshes snapshot")
    if data.get("version") != VERSION:
        raise SceneError(f"{path} has version {quoted(data.get('version'))}; this engine reads version {VERSION}: "
                         "export it again with the add-on of the engine's release")
    return data


def _many(cls: type, data: dict[str, Any], key: str) -> tuple[Any, ...]:
    items = data.get(key, [])
    if not isinstance(items, list):
        raise SceneError(f"scene.json: {key} must be a list")
    return tuple(built(cls, item, f"{key[:-1]} {n}") for n, item in enumerate(items))


def built(cls: type, data: Any, where: str) -> Any:
    """Return a dataclass from a JSON object, each value checked against the type of the field's default."""
    if not isinstance(data, dict):
        raise SceneError(f"scene.json: {where} is missing or not an object")
    fields = names_of(cls)
    unknown = set(data) - set(fields)
    if unknown:
        raise SceneError(f"{where}: there is no property {quoted(min(unknown))}")
    if isinstance(data.get("name"), str):
        where = f"{where} {quoted(data['name'])}"
    values, plain = {}, _plain_fields(cls)
    for name, default in fields.items():
        if name in data:
            value, kind = data[name], plain.get(name)
            right = kind and kind(value)
            values[name] = checked_value(cls, name, default, value, where) if not right else (
                tuple(value) if isinstance(value, list) else value)
        elif default is dataclasses.MISSING:
            raise SceneError(f"{where}: {name} is missing")
    return cls(**values)


@cache
def _plain_fields(cls: type) -> dict[str, Callable[[Any], bool]]:
    """Return field name → a function that says whether a value from JSON is right as it is, for fields that are
    numbers, text, yes or no.

    It says no where it is not sure, and takes a tenth of the time of `checked_value`: scenes may have thousands of
    lamps.
    """
    def kind(name: str, sample: Any) -> Callable[[Any], bool] | None:
        low, high = RANGES.get((cls, name), (-LARGEST, LARGEST))
        low, high = max(low, -sys.float_info.max), min(high, sys.float_info.max)
        choices = CHOICES.get((cls, name), ())
        if isinstance(sample, bool):
            return lambda value: value is True or value is False
        if isinstance(sample, float):
            return lambda value: type(value) is float and low <= value <= high
        if isinstance(sample, int):
            return lambda value: type(value) is int and low <= value <= high and abs(value) < 2**63
        if isinstance(sample, str):
            return lambda value: type(value) is str and (not choices or value in choices)
        floats = isinstance(sample, tuple) and all(isinstance(s, float) for s in sample)
        return None if not floats else lambda value: type(value) is list and len(value) == len(sample) and all(
            type(v) is float and low <= v <= high for v in value)

    samples = {name: SAMPLES.get((cls, name), "" if default is dataclasses.MISSING else default)
               for name, default in names_of(cls).items()}
    return {name: found for name, sample in samples.items() if (found := kind(name, sample))}


def with_setting(settings: Settings, key: str, text: str) -> Settings:
    """Return `settings` with one more set from text, as `--set key=value` gives it; h given by hand turns auto_h off.
    method.NAME is the setting NAME that the shadow method has for itself.
    """
    name, _, own = key.partition(".")
    if key not in names_of(Settings) and not (name == "method" and own):
        raise SceneError(f"there is no setting '{key}'; there are {', '.join(names_of(Settings))}")
    try:
        value = json.loads(text.lower() if text.lower() in ("true", "false") else text)
    except (ValueError, RecursionError):
        value = text
    if own:
        key, value = name, {**(settings.method or {}), own: value}
    value = checked_value(Settings, key, names_of(Settings)[key], value, "--set")
    changed: dict[str, Any] = {key: value} | ({"auto_h": False} if key == "h" else {})
    return dataclasses.replace(settings, **changed)


def checked_value(cls: type, name: str, default: Any, value: Any, where: str) -> Any:
    """Return `value` in the type of the field `name` of `cls`, whose default is `default`. Raises SceneError. Lists
    become tuples. `where` begins the error's sentence.
    """
    if (cls, name) == (Camera, "matrix"):
        try:
            matrix = np.array(value, np.float64)
        except (ValueError, TypeError):
            matrix = np.empty(0)
        if matrix.shape != (4, 4) or not (np.abs(matrix) <= LARGEST).all():
            raise SceneError(f"{where}: matrix must be 4 rows of 4 finite numbers, none beyond {LARGEST:g}")
        if np.linalg.matrix_rank(matrix[:3, :3]) < 3:
            raise SceneError(f"{where}: its matrix is flat: a scale of 0 leaves nothing to see")
        return matrix
    if name == "program":
        return programs.of_lamp(value, where) if cls is Light else programs.program(value, where)
    if name == "layers":
        return _layers(value, where)
    if value is None and default is None:
        return None
    if (cls, name) == (Settings, "method"):
        if not isinstance(value, dict) or not all(isinstance(v, bool | int | float | str) for v in value.values()):
            raise SceneError(f"{where}: method must be null, or an object of the shadow method's own settings")
        return dict(value)
    if cls in (Light, Object) and name in ("receivers", "blockers"):
        if not isinstance(value, list | tuple) or not all(type(i) is int for i in value):
            raise SceneError(f"{where}: {name} must be null or a list of objects' numbers")
        return tuple(value)
    sample = SAMPLES.get((cls, name), "" if default is dataclasses.MISSING else default)
    low, high = RANGES.get((cls, name), (-LARGEST, LARGEST))
    return bounded(where, name, typed(where, name, sample, value), CHOICES.get((cls, name), ()), low, high)


def _layers(items: Any, where: str) -> tuple[Material, ...]:
    """Return the checked layers of a material, from a JSON list. Raises SceneError."""
    if not isinstance(items, list | tuple) or len(items) > programs.LAYERS:
        raise SceneError(f"{where}: layers must be a list of {programs.LAYERS} materials at most")
    made = tuple(built(Material, item, f"{where}: layer {n}") for n, item in enumerate(items, 1))
    for n, layer in enumerate(made, 1):
        if layer.layers or layer.program:
            raise SceneError(f"{where}: layer {n} has layers or a program, which only the material itself has")
    return made


def check(scene: Scene) -> None:
    """Raise SceneError unless all indices of `scene` are valid. The values of vertices are not checked."""
    g = scene.geometry
    check_geometry(g, len(scene.objects), len(scene.materials))
    programs.check_world(scene.world, "world")
    if not all(0 <= image < len(scene.images) for image in scene.world.images()):
        raise SceneError("world: its program looks at an image that does not exist")
    owned = ((f"material {quoted(m.name)}", m.program) for m in scene.materials)
    for where, program in (("world", scene.world), *owned):
        if not all(0 <= profile < len(scene.profiles) for profile in program.profiles()):
            raise SceneError(f"{where}: its program looks at a profile that does not exist")
    for material in scene.materials:
        if not all(0 <= image < len(scene.images) for image in material.program.images()):
            raise SceneError(f"material {quoted(material.name)}: its program looks at an image that does not exist")
        if any(programs.layer_of(name)[0] > len(material.layers) for name in material.program.values):
            raise SceneError(f"material {quoted(material.name)}: its program is about a layer that does not exist")
        for image in (material.image, material.alpha_image, *(layer.image for layer in material.layers)):
            if not -1 <= image < len(scene.images):
                raise SceneError(f"material {quoted(material.name)}: image {image} does not exist")
            if image >= 0 and not len(g.uvs) and len(g.triangles):
                raise SceneError(f"material {quoted(material.name)} has an image, but there are no uvs")
    for picture in scene.images:
        if picture.colorspace not in COLORSPACES and not picture.ocio:
            raise SceneError(f"image {quoted(picture.name)}: colorspace is {quoted(picture.colorspace)}; choose one of "
                             f"{', '.join(COLORSPACES)}, or say in ocio whose it is")
    for light in scene.lights:
        for what, asked, count in (("an image", light.program.images(), len(scene.images)),
                                   ("a profile", light.program.profiles(), len(scene.profiles))):
            if asked and max(asked) >= count:
                raise SceneError(f"light {quoted(light.name)}: its program looks at {what} that does not exist")
    may_be_linked: tuple[Light | Object, ...] = (*scene.lights, *scene.objects)
    for linked in may_be_linked:
        kind = "light" if isinstance(linked, Light) else "object"
        for what, named in (("receiver", linked.receivers), ("blocker", linked.blockers)):
            if named and not (min(named) >= 0 and max(named) < len(scene.objects)):
                raise SceneError(f"{kind} {quoted(linked.name)} has a {what} that does not exist")
