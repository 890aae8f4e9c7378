"""A scene as Blender sees it at one frame → a snapshot folder that the engine reads."""

from collections.abc import Callable
from pathlib import Path

from . import camera, lights, linking, world
from .camera import border
from .geometry import Geometry
from .materials import Materials
from .report import ExportError, Report
from .snapshot import write

__all__ = ["ExportError", "Report", "border", "export", "settings"]


def export(engine, depsgraph, folder: Path, check: Callable[[], None], overrides: dict[str, dict] | None = None,
           ) -> Report:
    """Write what `depsgraph` holds into `folder`; `check` is called often, and ends the export by raising.

    `engine` is the RenderEngine, which knows the size of the picture. `overrides` replace what was found: "settings"
    by name, "lights" by the light object's name and then by name.
    """
    overrides = {"settings": {}, "lights": {}} | (overrides or {})
    report = Report()
    scene = depsgraph.scene_eval
    frame = camera.frame(engine, scene, depsgraph, report)
    materials = Materials(report, folder, depsgraph)
    geometry = Geometry(materials, report, check, depsgraph.view_layer_eval)
    lamps, links = [], linking.Links()
    for instance in depsgraph.object_instances:
        check()
        if not instance.show_self:
            continue
        ob = instance.object
        if ob.type == 'LIGHT':
            lamps.append(lights.light(ob, instance.matrix_world, report) | overrides["lights"].get(ob.name, {}))
            links.add(ob)
        else:
            geometry.add(instance, ob)
    links.link(lamps, geometry.owners)
    write(folder, geometry.arrays(), {
        "camera": frame,
        "lights": lamps,
        "materials": materials.descriptions,
        "images": materials.images,
        "objects": geometry.objects,
        "world_color": world.color(scene.world, report),
        "settings": settings(scene) | overrides["settings"],
        "warnings": report.sentences,
    })
    return report


def settings(scene) -> dict:
    """The engine's settings, from the scene's properties."""
    own = scene.light_meshes
    return {name: getattr(own, name) for name in (
        "mode", "shadows", "h", "kI", "auto_h", "weights", "samples", "light_samples", "max_depth", "ambient",
        "refraction", "glass", "caustics", "leak_free")} | {
        # The engine's filter is never wider than 10 pixels; Blender's slider goes on.
        "filter_size": min(scene.render.filter_size, 10.0),
        "film_transparent": scene.render.film_transparent,
    }
