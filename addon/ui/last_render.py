"""The panel of the last render: its cost, and the decisions of the engine."""

from typing import ClassVar

import bpy

from .. import penumbra, session
from .panel import LightMeshesPanel, paragraph, table

FOLLOW_SECONDS = 0.2


class LIGHT_MESHES_PT_last_render(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Last Render"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        if session.statistics:
            table(layout, context, rows(session.statistics, context.scene))
        else:
            paragraph(layout, context, "Render the scene (F12) to see here what it cost")
        layout.operator("light_meshes.keep_snapshot", icon='EXPORT')


class LIGHT_MESHES_PT_plan(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Plan"
    bl_parent_id = "LIGHT_MESHES_PT_last_render"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    @classmethod
    def poll(cls, context):
        return super().poll(context) and bool(session.statistics)

    def fill(self, layout, context):
        table(layout, context, [(what.title(), why)
                                for what, why in session.statistics["plan"].items()])


_followed: dict = {}  # statistics of the render that the panels show


def follow() -> float:
    """Redraw the panels when a render has ended. This uses a timer, because a render runs in another thread."""
    global _followed
    if session.statistics is not _followed:
        _followed = session.statistics
        for window in bpy.context.window_manager.windows:
            for area in window.screen.areas:
                if area.type == 'PROPERTIES':
                    area.tag_redraw()
    return FOLLOW_SECONDS


def rows(s: dict, scene) -> list[tuple[str, str]]:
    """Return the statistics `s` as rows of text for the panel. Figures that the engine did not give are left out."""
    result = [
        ("Picture", f"{s['scene']}, frame {s['frame']}, {s['width']}×{s['height']}, {count(s['samples'], 'sample')}"),
        ("Time", f"{s['seconds']:.2f} s on {count(s['threads'], 'thread')}"),
        ("Scene", f"{count(s['triangles'], 'triangle')}, {count(s['lights'], 'light')}"),
        ("Rays", f"{s['camera_rays']:,} camera, {s['secondary_rays']:,} mirrored or refracted, "
                 f"{s['shadow_rays']:,} shadow"),
    ]
    if "nodes" in s:
        result += [
            ("Lattice", f"h {penumbra.length(scene, s['h'])}, kI {s['kI']:.3g}, r {penumbra.length(scene, s['r'])}"),
            ("Nodes", f"{s['nodes']:,}, {s['node_share']:.1%} of the lattice, {s['long_rays']:,} rays to lights"),
            ("Points", f"{s['receivers']:,}; {share(s['uniform_skips'], s['receivers'])} needed no short rays, "
                       f"the others {s['short_rays']:,}"),
            ("Without Node", f"{count(s['empty_sets'], 'point')}, with sharp shadows"),
        ]
    if s.get("lamp_pairs"):
        result.append(("Lamps with a Size", f"{share(s['ray_pairs'], s['lamp_pairs'])} of the points needed rays, "
                                            f"{share(s['mixed_pairs'], s['lamp_pairs'])} are near penumbrae"))
    if "light_bound" in s:
        result.append(("Light Threshold", f"on average the light is wrong by less than {s['light_bound']:.2%} of that "
                                          "without shadows"))
    result += [(name, f"r {penumbra.length(scene, r)}") for name, r in [*s.get("light_radii", {}).items()][:10]]
    if "refracted_paths" in s:
        result.append(("Refracted Paths", f"{s['refracted_paths']:,}, {s['path_rays']:,} rays"))
    if s.get("peak_memory"):
        result.append(("Memory", f"{s['peak_memory'] / 2**20:,.0f} MiB at most"))
    stages = s.get("stages") or {}
    total = sum(stages.values())
    if total > 0:
        result.append(("Time Goes Into", ", ".join(f"{name} {share(seconds, total)}" for name, seconds in sorted(
            stages.items(), key=lambda item: -item[1]) if seconds >= 0.005 * total)))
    return result


def count(n: int, what: str) -> str:
    return f"{n:,} {what}" + ("" if n == 1 else "s")


def share(part: float, whole: float) -> str:
    return f"{part / whole:.0%}" if whole else "0%"


CLASSES = (LIGHT_MESHES_PT_last_render, LIGHT_MESHES_PT_plan)
