"""Operators that an artist can run: set a quality preset, measure the softness of shadows, write a snapshot for a bug
report.
"""

import shutil
import statistics
import threading
from pathlib import Path
from typing import NamedTuple

import bpy

from . import penumbra, session
from .export import ExportError
from .job import Cancelled, Job


class Preset(NamedTuple):
    """The settings of one quality level. They change the look only where a difference in quality is visible."""

    name: str
    description: str
    values: dict

    def is_set(self, own) -> bool:
        return all(getattr(own, key) == value for key, value in self.values.items())


# A point averages (2π/3)·kI³ nodes: 17, 57, 134 for kI 2, 3, 4. At the same h the cost of nodes and short rays grows in
# the same proportion.
PRESETS = {
    'DRAFT': Preset("Draft", "Fast: edges of objects are rough, those of shadows average some 17 nodes",
                    {"samples": 1, "kI": 2.0, "max_depth": 2, "light_samples": 16}),
    'BALANCED': Preset("Balanced", "Smooth at a normal look: edges of shadows average some 57 nodes",
                       {"samples": 4, "kI": 3.0, "max_depth": 4, "light_samples": 64}),
    'FINE': Preset("Fine", "For the last picture: 16 camera rays a pixel, edges of shadows average some 134 nodes",
                   {"samples": 16, "kI": 4.0, "max_depth": 8, "light_samples": 256}),
}


class LIGHT_MESHES_OT_preset(bpy.types.Operator):
    bl_idname = "light_meshes.preset"
    bl_label = "Quality Preset"
    bl_options = {'REGISTER', 'UNDO'}  # noqa: RUF012  Blender's own way

    level: bpy.props.EnumProperty(items=[(key, p.name, p.description, i) for i, (key, p) in enumerate(PRESETS.items())])

    @classmethod
    def description(cls, context, properties):
        return (f"{PRESETS[properties.level].description}. A step set by hand is changed with the quality, so that "
                "shadow edges stay as wide as they are; with the automatic step they get wider with the quality")

    def execute(self, context):
        own = context.scene.light_meshes
        r = own.h * own.kI
        for key, value in PRESETS[self.level].values.items():
            setattr(own, key, value)
        if not own.auto_h:
            own.h = r / own.kI
        return {'FINISHED'}


class Suggestion(NamedTuple):
    h: float
    kI: float
    why: str


# Limits of r as a share of the picture's longer side at the middle depth. Edges wider than WIDEST swallow the shadows
# of all small things. Edges narrower than NARROWEST are a few pixels wide and need more nodes than there are pixels.
WIDEST, NARROWEST = 0.04, 0.003
USUAL = 0.015  # r if no light has a size: that of the automatic step with a quality of 3


def suggested(h: float, radii: list[float]) -> Suggestion:
    """Return h and kI for a scene whose automatic step is `h`, and whose lights' sizes give the radii `radii`."""
    across = penumbra.AUTO_STEPS * h
    real = [r for r in radii if r > 0]
    if real:
        r = statistics.median(real)
        why = f"as wide as the size of the light{'s' if len(real) > 1 else ''} makes them"
        if r > WIDEST * across:
            r, why = WIDEST * across, "as wide as they can be before small shadows fade; the lights are larger"
        elif r < NARROWEST * across:
            r, why = NARROWEST * across, "as narrow as is worth its time; the lights are smaller"
    else:
        r, why = USUAL * across, "a thirtieth of what the camera sees across, as no light has a size"
    # Steps of grey are visible only in wide edges, so only these need a large kI.
    kI = 4.0 if r > 0.025 * across else 3.0 if r > 0.006 * across else 2.0
    return Suggestion(float(f"{r / kI:.2g}"), kI, why)


class _Watcher:
    """The part of a RenderEngine that a Job uses. An operator passes it to a Job instead of a RenderEngine."""

    camera_override = None
    is_animation = is_preview = False

    def __init__(self, render) -> None:
        self.resolution_x = max(render.resolution_x * render.resolution_percentage // 100, 1)
        self.resolution_y = max(render.resolution_y * render.resolution_percentage // 100, 1)
        self.cancelled = False

    def test_break(self) -> bool:
        return self.cancelled

    def update_stats(self, *_) -> None: ...
    def update_progress(self, *_) -> None: ...
    def report(self, *_) -> None: ...


class LIGHT_MESHES_OT_suggest(bpy.types.Operator):
    bl_idname = "light_meshes.suggest"
    bl_label = "Soften from Lamp Sizes"
    bl_description = ("Set step and quality by what the camera sees now and by the size of the lights, so that shadow "
                      "edges are as wide as they would be in reality. Switches the automatic step off")
    bl_options = {'REGISTER', 'UNDO'}  # noqa: RUF012

    @classmethod
    def poll(cls, context):
        return context.scene.camera is not None

    def execute(self, context):
        try:
            with self._asked(context) as job:
                found = job.measure()
        except (ExportError, session.EngineError) as e:
            self.report({'ERROR'}, str(e))
            return {'CANCELLED'}
        finally:
            session.discard(session.MEASURE)
        return self._take(context, found)

    def invoke(self, context, event):
        """Do the same as `execute`, but keep Blender's window responsive."""
        try:
            self._job = self._asked(context)
        except (ExportError, session.EngineError) as e:
            self.report({'ERROR'}, str(e))
            return {'CANCELLED'}
        self._answer = []
        self._thread = threading.Thread(target=self._wait, daemon=True)
        self._thread.start()
        self._timer = context.window_manager.event_timer_add(0.05, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set("Light Meshes is measuring what the camera sees. Esc: cancel")
        return {'RUNNING_MODAL'}

    def modal(self, context, event):
        if event.type == 'ESC':
            self._job.engine.cancelled = True
        if event.type != 'TIMER' or self._thread.is_alive():
            return {'RUNNING_MODAL'}
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        found = self._answer[0]
        if isinstance(found, dict):
            return self._take(context, found)
        if not isinstance(found, Cancelled):
            self.report({'ERROR'}, str(found))
        return {'CANCELLED'}

    def _asked(self, context) -> Job:
        """Return a job whose scene is exported and has lights whose size sets the edges of their shadows."""
        depsgraph = context.evaluated_depsgraph_get()
        job = Job(_Watcher(context.scene.render), depsgraph, session.MEASURE)
        try:
            settings = {"shadows": 'LIGHT_MESHES', "auto_h": True}
            job.export({"settings": settings, "lights": {"softness": 'LIGHT_SIZE'}})
        except BaseException:
            job.__exit__()
            session.discard(session.MEASURE)
            raise
        return job

    def _wait(self) -> None:
        """Wait for the engine; runs in a separate thread."""
        try:
            with self._job as job:
                self._answer.append(job.measure())
        except Exception as e:  # shown to the artist
            self._answer.append(e)
        finally:
            session.discard(session.MEASURE)

    def _take(self, context, found: dict):
        scene = context.scene
        usual = USUAL * penumbra.AUTO_STEPS * found["h"]  # of a light that casts no visible shadow
        best = suggested(found["h"], [usual if r is None else r for r in found["radii"].values()])
        own = scene.light_meshes
        own.auto_h, own.h, own.kI = False, best.h, best.kI
        width = penumbra.length(scene, 2 * best.h * best.kI)
        self.report({'INFO'}, f"Step {penumbra.length(scene, best.h)}, quality {best.kI:g}: "
                              f"shadow edges {width} wide, {best.why}")
        return {'FINISHED'}


class LIGHT_MESHES_OT_keep_snapshot(bpy.types.Operator):
    bl_idname = "light_meshes.keep_snapshot"
    bl_label = "Keep Snapshot…"
    bl_description = ("Write what the engine gets for the current frame into a new folder, for a bug report. "
                      "It can be rendered again without Blender")

    directory: bpy.props.StringProperty(name="Folder", description="Where the snapshot's folder is made",
                                        subtype='DIR_PATH')
    filter_folder: bpy.props.BoolProperty(default=True, options={'HIDDEN'})

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {'RUNNING_MODAL'}

    def execute(self, context):
        from .render_engine import export_frame

        scene = context.scene
        name = bpy.path.clean_name(f"{Path(bpy.data.filepath).stem or 'untitled'}-{scene.name}-{scene.frame_current}")
        parent = Path(bpy.path.abspath(self.directory)) if self.directory else Path.cwd()
        folder, n = parent / f"snapshot-{name}", 1
        while folder.exists():
            folder, n = parent / f"snapshot-{name}-{n + 1}", n + 1
        try:
            folder.mkdir(parents=True)
            try:
                export_frame(scene, folder)
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
        except (OSError, RuntimeError) as e:
            self.report({'ERROR'}, f"{folder} cannot be made: {e.strerror}" if isinstance(e, OSError) else
                        str(e).strip().removeprefix("Error: "))
            return {'CANCELLED'}
        self.report({'INFO'}, f"The snapshot is in {folder}. Render it again with: "
                              f"light-meshes render \"{folder}\" -o picture.png")
        return {'FINISHED'}


_CLASSES = (LIGHT_MESHES_OT_preset, LIGHT_MESHES_OT_suggest, LIGHT_MESHES_OT_keep_snapshot)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
