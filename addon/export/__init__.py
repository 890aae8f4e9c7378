"""A scene as Blender sees it at one frame → a snapshot folder that the engine reads."""

from collections.abc import Callable
from pathlib import Path

from . import camera, lights, linking, preview, world
from .camera import border
from .geometry import Geometry
from .materials import Materials
from .report import ExportError, Report
from .snapshot import write

FEW_SAMPLES = 16  # with fewer, the eye takes a blur apart
MOST_SAMPLES = 4096  # that the engine takes

__all__ = ["ExportError", "Report", "border", "export", "settings"]


def export(engine, depsgraph, folder: Path, check: Callable[[], None], overrides: dict[str, dict] | None = None,
           ) -> Report:
    """Write what `depsgraph` holds into `folder`; `check` is called often, and ends the export by raising.

    `engine` is the RenderEngine, which knows the size of the picture. `overrides` replace what was found: "settings"
    by name, "lights" by the light object's name and then by name.
    """
    overrides = {"settings": {}, "lights": {}} | (overrides or {})
    report = Report()
    scene, view_layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    values = settings(scene, view_layer) | (preview.SETTINGS if engine.is_preview else overrides["settings"])
    frame = camera.frame(engine, scene, depsgraph, report)
    if "lens_radius" in frame and values["samples"] < FEW_SAMPLES:
        report.warn(f"Depth of field with Samples at {values['samples']}: what is out of focus is shown as so many "
                    f"sharp copies; {FEW_SAMPLES} and more blur it")
    _other_limits(scene, view_layer, report)
    materials = Materials(report, folder, depsgraph)
    geometry = Geometry(materials, report, check, view_layer)
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
    if engine.is_preview:
        preview.adapt(geometry.objects, materials.descriptions)
    write(folder, geometry.arrays(), {
        "camera": frame,
        "lights": lamps,
        "materials": materials.descriptions,
        "images": materials.images,
        "objects": geometry.objects,
        "world_color": world.color(view_layer.world_override or scene.world, report),
        "settings": values,
        "warnings": report.sentences,
    })
    return report


def settings(scene, view_layer) -> dict:
    """The engine's settings, from the scene's properties and what the view layer has instead."""
    own = scene.light_meshes
    return {name: getattr(own, name) for name in (
        "mode", "shadows", "h", "kI", "auto_h", "weights", "light_samples", "max_depth", "ambient",
        "refraction", "glass", "caustics", "leak_free")} | {
        "samples": min(view_layer.samples, MOST_SAMPLES) or own.samples,
        # The engine's filter is never wider than 10 pixels; Blender's slider goes on.
        "filter_size": min(scene.render.filter_size, 10.0),
        "film_transparent": scene.render.film_transparent,
    }


def _other_limits(scene, view_layer, report: Report) -> None:
    if scene.render.use_multiview:
        raise ExportError("Light Meshes renders no stereo pictures: switch off Stereoscopy in the Output Properties")
    if scene.render.use_motion_blur and view_layer.use_motion_blur:
        report.warn("Motion Blur is switched on, but not rendered: what moves is sharp")
