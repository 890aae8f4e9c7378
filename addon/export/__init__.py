"""A scene as Blender sees it at one frame → a snapshot folder that the engine reads."""

from collections.abc import Callable
from pathlib import Path

from .camera import border, frame
from .geometry import Geometry
from .materials import Materials
from .report import ExportError, Report
from .snapshot import write
from .walk import Walk

__all__ = ["ExportError", "Report", "border", "export"]


def export(engine, depsgraph, folder: Path, check: Callable[[], None], **overrides) -> Report:
    """Write what `depsgraph` holds into `folder`; `check` is called often, and ends the export by raising.

    `engine` is the RenderEngine, which knows the size of the picture; `overrides` replace settings.
    """
    report = Report()
    camera = frame(engine, depsgraph.scene_eval, depsgraph, report)
    materials = Materials(report, folder, depsgraph)
    geometry = Geometry(materials, report, check)
    walk = Walk(materials, geometry, report, check)
    walk.go(depsgraph)
    description = walk.description(depsgraph, camera)
    description["settings"] |= overrides
    write(folder, geometry.arrays(), description)
    return report
