"""The render engine that Blender sees."""

import traceback
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.app.handlers import persistent

from . import observers, passes, session, step, viewport
from .export import ExportError
from .job import Cancelled, Job


class LightMeshesEngine(bpy.types.RenderEngine):
    bl_idname = 'LIGHT_MESHES'
    bl_label = "Light Meshes"
    bl_use_preview = False
    bl_use_postprocess = True
    bl_use_eevee_viewport = True
    bl_use_shading_nodes_custom = False

    _viewport: viewport.Viewport | None = None

    export_to: ClassVar[Path | None] = None  # export there and render nothing, as the headless driver may want

    def update_render_passes(self, scene=None, renderlayer=None):
        for p in passes.wanted(renderlayer):
            self.register_pass(scene, renderlayer, p.name, p.channels, p.channel_ids, p.kind)

    def render(self, depsgraph):
        try:
            with Job(self, depsgraph) as job:
                h = step.for_frame(job)
                job.export(h, self.export_to)
                if not self.export_to:
                    job.render()
        except Cancelled:
            pass  # Blender knows
        except KeyboardInterrupt:  # Ctrl-C where Python is the host; Blender would not know that it ended early
            self._fail("The render was interrupted", "")
        except (ExportError, session.EngineError) as e:
            self._fail(str(e), getattr(e, "log", ""))
        except Exception as e:  # the boundary: Blender itself would finish with an empty picture
            self._fail(f"The Light Meshes add-on failed: {type(e).__name__}: {e}", traceback.format_exc())

    def view_update(self, context, depsgraph):
        if not self._viewport:
            self._viewport = viewport.Viewport(self)
        self._viewport.update(context, depsgraph)

    def view_draw(self, context, depsgraph):
        if self._viewport:
            self._viewport.draw(context, depsgraph)

    def __del__(self):
        if self._viewport:  # the view is closed, or shaded in another way
            self._viewport.end()

    def _fail(self, message, log):
        if log:
            print(f"Light Meshes, the end of the log:\n{log}", flush=True)
        self.report({'ERROR'}, message)  # exit code 1
        self.error_set(message)  # in the picture's window
        observers.notify(event="error", message=message)


@persistent
def _another_file(*_):
    session.forget()


def register() -> None:
    bpy.app.handlers.load_pre.append(_another_file)
    bpy.utils.register_class(LightMeshesEngine)
    step.register()


def unregister() -> None:
    bpy.app.handlers.load_pre.remove(_another_file)
    step.unregister()
    bpy.utils.unregister_class(LightMeshesEngine)
    viewport.end_all()
    session.end()
