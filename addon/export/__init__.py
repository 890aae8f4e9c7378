"""Export a scene, as Blender sees it at one frame, into a snapshot folder that the engine reads."""

from collections.abc import Callable
from pathlib import Path

from .. import cryptomatte
from . import left_out, preview
from .camera import border, frame
from .geometry import Geometry
from .materials import Materials
from .report import ExportError, Report
from .snapshot import write
from .walk import Walk

__all__ = ["ExportError", "Report", "border", "export"]


def export(engine, depsgraph, folder: Path, check: Callable[[], None], overrides: dict[str, dict] | None = None,
           ) -> Report:
    """Write the contents of `depsgraph` into `folder`. `check` is called often; it cancels the export by raising.

    `engine` is the RenderEngine, which knows the size of the picture. `overrides` replace exported values: "settings"
    by name; "lights", values for all lights by name; and "sized lights", values for lights with softness LIGHT_SIZE, by
    light and then by name.
    """
    overrides = {"settings": {}, "lights": {}, "sized lights": {}} | (overrides or {})
    report = Report()
    scene, view_layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    _refuse(scene)
    left_out.settings(scene, view_layer, report)
    camera = frame(engine, scene, depsgraph, report)
    materials = Materials(report, folder, depsgraph)
    materials.every_uv = view_layer.use_pass_uv
    geometry = Geometry(materials, report, check, view_layer)
    walk = Walk(materials, geometry, report, check)
    walk.go(depsgraph)
    description = walk.description(
        depsgraph, camera, preview.SETTINGS if engine.is_preview else overrides["settings"])
    for which, light in zip(walk.lamps, description["lights"], strict=True):
        light |= overrides["lights"]
        sized = light["softness"] == 'LIGHT_SIZE'
        report.lights.append(which if sized else None)
        light |= overrides["sized lights"].get(which, {}) if sized else {}
    report.mattes = cryptomatte.add_numbers(description, view_layer)
    if engine.is_preview:
        preview.adapt(description)
    write(folder, geometry.arrays(), description)
    return report


def _refuse(scene) -> None:
    if scene.render.use_multiview:
        raise ExportError("Light Meshes renders no stereo pictures: switch off Stereoscopy in the Output Properties")
