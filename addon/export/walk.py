"""The way through all that a depsgraph holds, and the description of what was met."""

from collections.abc import Callable
from itertools import islice

from . import lights, world
from .geometry import Geometry
from .materials import Materials
from .report import Report


class Walk:
    """Takes in one instance after the other, and calls `check` after each.

    When `check` raises, `go` may be called again, and goes on from there. Nothing of Blender's is held meanwhile, so
    whoever finds that the scene changed just begins another walk.
    """

    def __init__(self, materials: Materials, geometry: Geometry, report: Report, check: Callable[[], None]) -> None:
        self.lamps: list[dict] = []
        self._materials, self._geometry, self._report, self._check = materials, geometry, report, check
        self._done = 0

    def go(self, depsgraph, seen: Callable[[object], bool] = lambda ob: True) -> None:
        """Take in what is left of the depsgraph's instances; `seen` says of an object whether it is to be seen."""
        for instance in islice(depsgraph.object_instances, self._done, None):
            if instance.show_self and seen(instance.object):
                self._take(instance, instance.object)
            self._done += 1
            self._check()

    def _take(self, instance, ob) -> None:
        if ob.type == 'LIGHT':
            self.lamps.append(lights.light(ob, instance.matrix_world, self._report))
        else:
            self._geometry.add(instance, ob)

    def description(self, depsgraph, camera: dict) -> dict:
        """What scene.json says, once all is taken in."""
        scene = depsgraph.scene_eval
        return {
            "camera": camera,
            "lights": self.lamps,
            "materials": list(self._materials.descriptions),
            "images": list(self._materials.images),
            "objects": self._geometry.objects,
            "world_color": world.color(scene.world, self._report),
            "settings": settings(scene),
            "warnings": self._report.sentences,
        }


def settings(scene) -> dict:
    """The engine's settings, from the scene's properties."""
    own = scene.light_meshes
    return {name: getattr(own, name) for name in (
        "mode", "shadows", "h", "kI", "auto_h", "samples", "light_samples", "max_depth", "ambient",
        "refraction", "glass", "caustics", "leak_free")} | {
        # The engine's filter is never wider than 10 pixels; Blender's slider goes on.
        "filter_size": min(scene.render.filter_size, 10.0),
        "film_transparent": scene.render.film_transparent,
    }
