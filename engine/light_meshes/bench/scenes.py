"""The scenes of the benchmark: the .blend files in `blend_scenes/`, and the hall with any number of triangles."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from math import atan
from pathlib import Path
from typing import Any

import numpy as np

from ..frontends import blend
from ..picture.prepared import Prepared
from ..picture.render import measure
from ..scene import snapshot
from ..scene.description import Camera, Light, Material, Object, Scene, Settings, Shape
from ..scene.errors import SceneError
from ..scene.geometry import Geometry
from ..scene.mesh import box, cylinder, sphere
from ..scene.transforms import scale, translate

FILES = {"S3": "tabletop", "S5": "lens", "S7": "hall", "S8": "desk"}
MATCHED = ("S3", "S7")  # the lights of these scenes get the size that corresponds to the width of the penumbrae


@dataclass(frozen=True)
class Case:
    """A scene to be measured. Its world is black, because then direct light can be compared with Cycles."""

    name: str  # S3, S5, S7 or S8
    scene: Scene
    file: Path  # the .blend
    power: float  # factor for the power of its lights
    # of its lights, for Cycles: a radius, or a sun's angle; None means the size in the file
    sizes: dict[str, float | None]
    rule: str  # how the sizes were chosen

    @property
    def lights(self) -> int:
        """Return the number of lights."""
        return len(self.scene.lights)

    @property
    def title(self) -> str:
        """Return the title for tables and figures."""
        return f"{self.name}, {self.lights} light{'s' * (self.lights > 1)}"


def blend_folder() -> Path:
    """Return the folder blend_scenes/, beside the sources or in the current folder. Raises SceneError if there is
    none.
    """
    for place in (Path(__file__).resolve().parents[3], Path.cwd()):
        if (place / "blend_scenes" / f"{FILES['S7']}.blend").is_file():
            return place / "blend_scenes"
    raise SceneError("the benchmark renders the files of blend_scenes/, which is not here: run it in a checkout of "
                     "the project")


def exported(name: str, folder: Path) -> Scene:
    """Export scene `name` with the add-on into `folder`, which must exist as long as the scene is used; its world is
    made black.
    """
    if not (folder / "scene.json").exists():
        blend.export(blend_folder() / f"{FILES[name]}.blend", folder, [], False)
    scene = dataclasses.replace(snapshot.read(folder), world_color=(0.0, 0.0, 0.0))
    return scene.with_settings(h=measure(scene)["h"], auto_h=False) if scene.settings.auto_h else scene


def case(name: str, scene: Scene, lights: int | None = None) -> Case:
    """Return the case with the first `lights` lights of the scene. These get the power of all, and sizes that suit the
    width of the penumbrae.
    """
    lights = lights or len(scene.lights)
    power = len(scene.lights) / lights
    scene = dataclasses.replace(scene, lights=tuple(
        dataclasses.replace(light, intensity=(power * light.intensity[0], power * light.intensity[1],
                                              power * light.intensity[2])) for light in scene.lights[:lights]))
    sizes: dict[str, float | None] = {light.name: None for light in scene.lights}
    rule = "lights' sizes as in the file"
    if name in MATCHED:
        scene = dataclasses.replace(scene, lights=matched(scene))
        sizes = {light.name: light.angle if light.type == "SUN" else light.radius for light in scene.lights}
        seen = sorted(size for size in sizes.values() if size)
        rule = (f"r = {radius(scene):.4g} = 1.12·ρ·a/(L − a) with the median of a/(L − a) over what the camera sees in "
                f"each light's shadow: ρ = {seen[0]:.3g}" +
                (f" … {seen[-1]:.3g}, median {np.median(seen):.3g}" if len(seen) > 1 else ""))
    return Case(name, scene, blend_folder() / f"{FILES[name]}.blend", power, sizes, rule)


def radius(scene: Scene) -> float:
    """Return r = h·kI of the scene's settings."""
    return scene.settings.h * scene.settings.kI


def sized(scene: Scene, edge: int, **settings: Any) -> Scene:
    """Return the scene with its whole frame in edge² pixels, whatever its shape, and with some settings changed."""
    camera = scene.camera
    stretch = np.sqrt(camera.width / camera.height)
    camera = dataclasses.replace(camera, width=max(1, round(edge * stretch)), height=max(1, round(edge / stretch)),
                                 crop=None)
    return dataclasses.replace(scene, camera=camera).with_settings(**settings)


def matched(scene: Scene) -> tuple[Light, ...]:
    """Return the lights, each with the size for which `light_size` would choose the scene's r, from what the camera
    sees.
    """
    unit = tuple(dataclasses.replace(_with_size(light, 1.0), softness="LIGHT_SIZE", reference_distance=0.0)
                 for light in scene.lights)
    own = Prepared(dataclasses.replace(scene, lights=unit).with_settings(shadows="SHARP")).measured.own_radii
    usual = float(np.median([*own.values()])) if own else radius(scene)  # for a light without shadows in view
    return tuple(_with_size(light, radius(scene) / own.get(i, usual)) for i, light in enumerate(scene.lights))


def _with_size(light: Light, size: float) -> Light:
    """Return the light with radius ρ, or for a sun with this tangent of half its angle."""
    return dataclasses.replace(light, angle=2 * atan(size)) if light.type == "SUN" \
        else dataclasses.replace(light, radius=size)


# --- The hall of blend_scenes/hall.py at any number of triangles ---------------------------------------------

PLACES = 6  # in each direction


def hall(scene: Scene, triangles: int) -> Scene:
    """Return S7 with about `triangles` triangles: columns and balls have the same shapes and a suitable number of
    sides.
    """
    # A place has sides² + 2·sides triangles: a column has 4·sides, a ball 2·sides·(sides/2 − 1).
    sides = max(4, 2 * round((np.sqrt(1 + triangles / PLACES**2) - 1) / 2))
    step = 4 / PLACES
    meshes = [box((-2.2, -2.2, -0.1), (2.2, 2.2, 0)), box((-2.3, -2.2, 0), (-2.2, 2.2, 2)),
              box((-2.2, 2.2, 0), (2.2, 2.3, 2)), cylinder(0.12 * step, 0, 1.2, sides, smooth=True),
              sphere(0.16 * step, sides, sides // 2)]
    places = [(step * (i + 0.5) - 2, step * (j + 0.5) - 2) for i in range(PLACES) for j in range(PLACES)]
    instances = [(mesh, 0, np.eye(4)) for mesh in range(3)]
    for x, y in places:
        ball = translate(x + 0.33 * step, y - 0.3 * step, 0.17 * step) @ scale(1, 1, 0.9)
        instances += [(3, 0, translate(x, y, 0)), (4, 0, ball)]
    colours = ((0.8, 0.8, 0.8), (0.7, 0.4, 0.3), (0.3, 0.5, 0.7), (0.7, 0.7, 0.3))
    return dataclasses.replace(scene, geometry=Geometry.from_meshes(meshes, (0, 1, 2, 0, 3), instances),
                               objects=(Object("hall"),), images=(),
                               materials=tuple(Material(f"material {n}", Od=c) for n, c in enumerate(colours)))


# --- Clutter: boxes that stand close together under many lamps ----------------------------------------------------


def clutter(lights: int) -> Case:
    """Return 60 boxes of many sizes on a floor, under so many spheres of light."""
    random = np.random.default_rng(3)
    meshes = [box((-4, -4, -0.1), (4, 4, 0))]
    for x, y in random.uniform(-1.6, 1.6, (60, 2)):
        wide, deep, high = random.uniform((0.04, 0.04, 0.05), (0.18, 0.18, 0.7))
        meshes.append(box((x - wide, y - deep, 0), (x + wide, y + deep, high)))
    places = [(2.2 * np.cos(a), 2.2 * np.sin(a), 2.0 + 0.5 * np.sin(5 * a))
              for a in np.arange(lights) * 2 * np.pi / lights]
    lamps = tuple(Light(f"lamp {i}", "POINT", (30 / lights,) * 3, position=(float(x), float(y), float(z)), radius=0.15)
                  for i, (x, y, z) in enumerate(places))
    grey = Material("grey", Od=(0.7, 0.7, 0.7))
    scene = Scene.from_shapes([Shape(mesh, grey, f"{n}") for n, mesh in enumerate(meshes)],
                              Camera.look_at((0, -4.6, 3.6), (0, 0, 0), 40, 1000, 1000), lamps,
                              Settings(mode="WHITTED", weights="SMOOTH"))
    return Case("clutter", scene, Path(), 1.0, {}, "spheres of light of radius 0.15")
