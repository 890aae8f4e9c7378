"""The render engine class that Blender uses."""

import atexit
import traceback
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.app.handlers import persistent

from . import console, observers, passes, session, step, viewport
from .export import ExportError
from .job import Cancelled, Job

# Settings that make Blender process a picture. They are off while only a snapshot is written: there is no picture then,
# and Freestyle would crash Blender.
_AROUND = ("use_compositing", "use_sequencer", "use_freestyle", "use_stamp")
_SLOT = "Snapshot"  # the slot of the render result for exports, which leave an empty picture


class LightMeshesEngine(bpy.types.RenderEngine):
    bl_idname = 'LIGHT_MESHES'
    bl_label = "Light Meshes"
    bl_use_preview = True
    bl_use_postprocess = True
    bl_use_eevee_viewport = True
    bl_use_shading_nodes_custom = False

    _viewport: viewport.Viewport | None = None

    # if set, export into this folder and render nothing; the headless driver uses it
    export_to: ClassVar[Path | None] = None

    def update_render_passes(self, scene=None, renderlayer=None):
        for p in passes.wanted(scene, renderlayer):
            self.register_pass(scene, renderlayer, p.name, p.channels, p.channel_ids, p.kind)

    def render(self, depsgraph):
        try:
            with Job(self, depsgraph) as job:
                job.export(step.for_frame(job), self.export_to)
                if not self.export_to:
                    job.render()
        except Cancelled:
            pass  # Blender knows about it already
        except KeyboardInterrupt:  # Ctrl-C with Python as the host; Blender would not know that the render ended early
            self._fail("The render was interrupted", "")
        except (ExportError, session.EngineError) as e:
            self._fail(str(e), getattr(e, "log", ""))
        except Exception as e:  # the last place to catch it: otherwise Blender would finish with an empty picture
            self._fail(f"The Light Meshes add-on failed: {type(e).__name__}: {e}", traceback.format_exc())

    def view_update(self, context, depsgraph):
        if not self._viewport:
            self._viewport = viewport.Viewport(self)
        self._viewport.update(context, depsgraph)

    def view_draw(self, context, depsgraph):
        if self._viewport:
            self._viewport.draw(context, depsgraph)

    def _fail(self, message, log):
        if self.is_preview:  # Blender shows no errors of previews
            console.say(f"Light Meshes, preview: {console.shown(message)}")
            return
        if log:
            console.say(f"Light Meshes, the end of the log:\n{log}")
        self.report({'ERROR'}, console.shown(message))  # this makes Blender's exit code 1
        self.error_set(console.shown(message))  # this shows it in the picture's window
        observers.notify(event="error", message=message)


def export_frame(scene, folder: Path) -> None:
    """Export the current frame of `scene` into `folder`, as a render sees it, and render nothing.

    The export runs inside a render, because only a render sees the objects and modifiers that are enabled for renders.
    The render must neither change the artist's last picture nor write files.
    """
    render = scene.render
    before = {name: getattr(render, name) for name in _AROUND}
    # If there are several layers, only the visible one writes files; all of them would write the same.
    layers = sorted((layer for layer in scene.view_layers if layer.use), key=lambda one: one != bpy.context.view_layer)
    if not layers:
        raise RuntimeError(f"Scene '{scene.name}' renders no view layer: switch Use for Rendering on")
    slots = bpy.data.images["Render Result"].render_slots if "Render Result" in bpy.data.images else None
    shown = slots.active_index if slots else 0
    try:
        for name in _AROUND:
            setattr(render, name, False)
        if slots:
            slots.active = next((s for s in slots if s.name == _SLOT), None) or slots.new(name=_SLOT)
        LightMeshesEngine.export_to = folder
        bpy.ops.render.render(scene=scene.name, **{"layer": layers[0].name} if len(layers) > 1 else {})
    finally:
        LightMeshesEngine.export_to = None
        for name, value in before.items():
            setattr(render, name, value)
        if slots:
            slots.active_index = shown


@persistent
def _another_file(*_):
    session.statistics = {}  # these were of the previous file
    session.forget()


def register() -> None:
    bpy.app.handlers.load_pre.append(_another_file)
    bpy.utils.register_class(LightMeshesEngine)
    step.register()
    atexit.register(session.end)


def unregister() -> None:
    bpy.app.handlers.load_pre.remove(_another_file)
    step.unregister()
    bpy.utils.unregister_class(LightMeshesEngine)
    viewport.end_all()
    session.end()
    atexit.unregister(session.end)
