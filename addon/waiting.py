"""An engine that waits: it is started as soon as a scene is to be rendered with Light Meshes, not when it is asked for.

Starting it takes about half a second, for Python's imports. The next 3D view, render or preview takes it, and a little
later another one is started. There is at most one, only in a Blender with a window, and only as long as a scene of the
open file uses Light Meshes.
"""

import bpy
from bpy.app.handlers import persistent

from . import engine_python, session
from .job import temporary_folder

ENGINE = 'LIGHT_MESHES'
SOON = 0.2  # seconds until Blender has drawn its window
PERIOD = 4.0  # seconds until it is looked again: the one that took the engine has its first picture by then
_owner = object()  # of the subscription
_on = False  # whether the add-on is switched on, in a Blender with a window


def look() -> float | None:
    """Start an engine that waits, or end it, as the open file asks; a timer calls it. Returns when to look again: not
    before something changes, if no engine is wanted, or if it cannot be started.
    """
    if any(scene.render.engine == ENGINE for scene in bpy.data.scenes):
        engine_python.set_temporary(temporary_folder())
        return PERIOD if session.wait_for_work() else None
    session.end_waiting()
    return None


def soon() -> None:
    """Call `look` when Blender is not busy."""
    if _on:
        if bpy.app.timers.is_registered(look):
            bpy.app.timers.unregister(look)
        bpy.app.timers.register(look, first_interval=SOON)


def _listen() -> None:
    bpy.msgbus.clear_by_owner(_owner)
    bpy.msgbus.subscribe_rna(key=(bpy.types.RenderSettings, "engine"), owner=_owner, args=(), notify=soon)


@persistent
def _another_file(*_):
    _listen()  # Blender forgets subscriptions when it opens a file
    soon()


def register() -> None:
    global _on
    if bpy.app.background:
        return
    _on = True
    bpy.app.handlers.load_post.append(_another_file)
    _listen()
    soon()


def unregister() -> None:
    global _on
    if not _on:
        return
    _on = False
    bpy.msgbus.clear_by_owner(_owner)
    bpy.app.handlers.load_post.remove(_another_file)
    if bpy.app.timers.is_registered(look):
        bpy.app.timers.unregister(look)
    session.end_waiting()
