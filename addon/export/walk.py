"""Visit everything that a depsgraph contains, and build the description."""

from collections.abc import Callable
from itertools import islice

from .. import everywhere
from ..properties import caustics_of
from . import color, lights, world
from .geometry import Geometry
from .materials import Materials
from .report import Report

FEW_SAMPLES = 16  # with fewer samples, the blur is visible as separate copies
MOST_SAMPLES = 4096  # the engine's maximum


class Walk:
    """Takes in one instance after the other, and calls `check` after each.

    If `check` raises, `go` may be called again and continues from there. Meanwhile it holds no data of Blender, so if
    the scene has changed, the caller can simply begin another walk.
    """

    def __init__(self, materials: Materials, geometry: Geometry, report: Report, check: Callable[[], None]) -> None:
        self._lamps: list[dict] = []
        self.lamps: list[tuple] = []  # the key of each light, from `_identity`
        self._materials, self._geometry, self._report, self._check = materials, geometry, report, check
        self._done = 0

    def go(self, depsgraph, seen: Callable[[object], bool] = lambda ob: True) -> None:
        """Take in the remaining instances of the depsgraph. `seen` says whether an object is visible."""
        for instance in islice(depsgraph.object_instances, self._done, None):
            if instance.show_self and seen(instance.object):
                self._take(instance, instance.object, depsgraph)
            self._done += 1
            self._check()

    def _take(self, instance, ob, depsgraph) -> None:
        if ob.type == 'LIGHT':
            self._lamps.append(lights.light(instance, ob, depsgraph, self._report, self._materials))
            self.lamps.append(_identity(instance, ob))
            self._geometry.links.add(ob)
        else:
            self._geometry.add(instance, ob)

    def description(self, depsgraph, camera: dict, overrides: dict | None = None) -> dict:
        """Return the contents of scene.json, after everything is taken in; `overrides` replace settings."""
        scene, view_layer = depsgraph.scene_eval, depsgraph.view_layer_eval
        shown_world = view_layer.world_override or scene.world
        values = settings(scene, view_layer) | _mist(shown_world, view_layer) | (overrides or {})
        if "lens_radius" in camera and values["samples"] < FEW_SAMPLES:
            self._report.warn(f"Depth of field with Samples at {values['samples']}: things out of focus appear as "
                              f"so many sharp copies; with {FEW_SAMPLES} or more they are blurred")
        self._geometry.links.link(self._lamps, self._geometry.objects, self._geometry.owners)
        background = world.described(
            shown_world, self._report, lambda node, tile: self._materials.image(node, self._report, tile),
            self._materials.profiles, depsgraph)
        return {
            "camera": camera,
            "lights": self._lamps,
            "materials": list(self._materials.descriptions),
            "images": list(self._materials.images),
            "profiles": list(self._materials.profiles.descriptions),
            "objects": self._geometry.objects,
            **background,
            "settings": values,
            "to_rec709": color.to_rec709(),
            "warnings": self._report.sentences,
        }


def _identity(instance, ob) -> tuple:
    """Return a key that identifies an object in every frame. A name is not enough: all instances of one object have the
    same name.
    """
    parent = instance.parent
    return ob.name_full, parent.name_full if parent else "", *(instance.persistent_id if instance.is_instance else ())


def settings(scene, view_layer) -> dict:
    """Return the engine's settings from the scene's properties, with the replacements of the view layer."""
    own = scene.light_meshes
    return {name: getattr(own, name) for name in (
        "mode", "shadows", "h", "kI", "auto_h", "weights", "shadow_rate", "light_threshold", "light_samples",
        "max_depth", "fast_reflections", "ambient", "refraction", "glass", "leak_free")} | {
        **everywhere.of(scene),
        "caustics": caustics_of(own),
        "samples": min(view_layer.samples, MOST_SAMPLES) or own.samples,
        # The engine's filter is never wider than 10 pixels; Blender's slider allows more.
        "filter_size": min(scene.render.filter_size, 10.0),
        "film_transparent": scene.render.film_transparent,
    }


def _mist(shown_world, view_layer) -> dict:
    """Return the settings of the world for the pass Mist."""
    if not (view_layer.use_pass_mist and shown_world):
        return {}
    mist = shown_world.mist_settings
    return {"mist_start": mist.start, "mist_depth": mist.depth, "mist_falloff": mist.falloff}
