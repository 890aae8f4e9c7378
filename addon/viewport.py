"""A rendered 3D view: it exports changes, asks the engine for pictures, and draws the last picture.

Blender calls `update` when data changed, and `draw` whenever the region is drawn. Between these calls a timer reads the
engine's events. Nothing here blocks: a long export is done in slices, and each slice is followed by a redraw.

Each step is finished and shown before a newer one begins: export, ask, show the first picture, then export what has
changed meanwhile. So a view whose scene changes without a pause shows one picture after the other, however slow they
are. A picture is cancelled for a newer one only after it has been shown once.
"""

from __future__ import annotations

import time
import traceback
import weakref
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import bpy
import numpy as np

from . import console, engine_python, screen, session, view, waiting
from .export import ExportError, camera
from .export.scenes import Scenes
from .export.snapshot import handing_over
from .export.walk import settings
from .job import temporary_folder, threads

SLICE_SECONDS = 0.04  # duration of the first slice of an export, between two redraws; each later one is longer,
LONGER, LONGEST = 1.5, 0.16  # by this factor, but not longer than this many seconds
WRITE_SECONDS = 0.06  # Blender waits so long for files; else it would draw the view first, and that may take longer
TICK_SECONDS = 0.01  # how often the engine's output is read
TELL_SECONDS = 0.5  # how often it is said what the engine does
ENDING_SECONDS = 0.3  # another part has asked this engine to end, and it removes its files first
RESTARTS = 2  # after this many engines in a row that end before they finish a picture, the view waits for a change
# [divisor of the resolution, samples]; after these steps, all samples of a render
STEPS = [[8, 1], [4, 1], [2, 1], [1, 1]]
DIRECT = True  # pictures of direct light come before these, if these are expected to take long

viewports: weakref.WeakSet[Viewport] = weakref.WeakSet()  # all open views


@dataclass
class _Asked:
    """A command that was sent to the engine."""

    number: int
    scene: Path
    view: view.View
    seen: bool = False  # whether a part of its picture has arrived
    running: bool = True


class Viewport:
    """The state of one 3D view. Each view has its own engine, so that renders can go on at the same time."""

    def __init__(self, engine) -> None:
        self._engine = weakref.ref(engine)
        self._session: session.Session | None = None
        self._scenes: Scenes | None = None
        self._exporting = False  # something has changed, and not all of it is exported yet
        self._slice = SLICE_SECONDS
        self._scene: Path | None = None  # the last scene that was exported
        self._samples = 1
        self._threads: int | None = None
        self._home: dict | None = None  # the camera for measuring h, if the scene has none
        self._view: view.View | None = None
        self._asked: _Asked | None = None
        self._picture = screen.Picture()
        self._text = ""
        self._told = 0.0  # when it was said what the engine does
        self._failed = False  # set until something changes
        self._lost = 0  # engines that ended since the last finished picture
        self._timer = self._tick  # stored once, because Blender identifies timers by the function object
        # the longest times for which Blender had to wait: seconds in all, and seconds of processor time
        self.longest: dict[str, tuple[float, float]] = {}
        self.pictures = 0
        self.statistics: dict = {}  # of the last finished picture
        viewports.add(self)
        weakref.finalize(engine, self.end).atexit = False  # called when the view is closed, or shaded in another way

    def update(self, context, depsgraph) -> None:
        """Blender calls this at the start, and when data changed."""
        with self._boundary("update"):
            # the export starts again; longer slices make sure that it ends, however often the scene changes
            if self._may_export:
                self._slice *= 2
            self._failed = False
            self._exporting = True
            if self._scenes:
                self._scenes.note(depsgraph)
            self._view = view.current(context, depsgraph.scene, depsgraph)
            self._go_on(context, depsgraph)

    def draw(self, context, depsgraph) -> None:
        """Draw the last picture, and ask for a new one if the view has changed."""
        with self._boundary("draw"):
            seen = view.current(context, depsgraph.scene, depsgraph)
            if seen != self._view:
                self._view, self._failed = seen, False
            if not self._failed:
                self._go_on(context, depsgraph)
        with self._boundary("draw"):
            if self._view:
                self._picture.draw(self._engine(), depsgraph.scene)
            if self._failed:
                screen.sentence(context, self._text)

    def end(self) -> None:
        """End the engine, without waiting."""
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)
        viewports.discard(self)
        self._leave(session.Session.end)
        waiting.soon()  # the artist may come back to this shading

    def _go_on(self, context, depsgraph) -> None:
        if not self._session:
            engine_python.set_temporary(temporary_folder())
            self._session = session.ready()
            self._session.make_polite()
            self._say("Starting the engine")
        if (self._exporting or self._differs) and not self._session.alive:
            raise self._session.gone()  # it ended while idle; a new one gets the request
        if self._session.folder and not self._scenes:
            with handing_over():
                self._scenes = Scenes(self._session.new_folder())
            self._scenes.note(depsgraph)
            self._exporting = True
        if self._may_export:
            self._export(context, depsgraph)
        self._ask()
        if self._waits and not bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.register(self._timer, first_interval=TICK_SECONDS)

    def _export(self, context, depsgraph) -> None:
        assert self._scenes
        space, scene = context.space_data, depsgraph.scene_eval
        if not scene.camera and not self._home and self._view:
            self._home = self._view.camera

        def eye(report):
            # The camera for measuring h is the one of renders, so that the view has the same shadows as a render from
            # all sides.
            found = camera.frame(view.Final(scene), scene, depsgraph, report) if scene.camera else self._home
            assert found  # the view's own, which was taken above
            return found | {"crop": None}

        with handing_over():
            path = self._scenes.advance(depsgraph, self._slice, eye, lambda ob: ob.visible_in_viewport_get(space))
        if path:
            self._scenes.written(WRITE_SECONDS)
            self._scene, self._exporting, self._slice = path, False, SLICE_SECONDS
            self._samples = settings(scene, depsgraph.view_layer_eval)["samples"]
            self._threads = threads(scene)
            if not self._waits and self.statistics:  # nothing that is visible has changed
                self._say(summary(self.statistics))
        else:
            self._slice = max(self._slice, min(self._slice * LONGER, LONGEST))
            self._say("Exporting the scene")
            self._redraw()

    def _ask(self) -> None:
        """Ask for the picture that is wanted, unless it was asked for already or cannot be asked for yet."""
        last = self._asked
        if not (self._session and self._scene and self._scenes and self._view and self._differs
                and self._scenes.written()) or self._unseen:
            return
        if self._exporting and not self._exported:
            return  # both the view and the scene have changed: make one picture of both
        if last and last.running:
            self._session.ask_to_cancel(last.number)
        steps = STEPS + ([[1, self._samples]] if self._samples > 1 else [])
        number = self._session.send(
            "view", snapshot=str(self._scene), framebuffer=str(self._scene.with_name("view")),
            camera=self._view.camera, passes=["Combined"], steps=steps, direct=DIRECT, threads=self._threads)
        self._asked = _Asked(number, self._scene, self._view)
        self._say("Rendering")

    @property
    def _differs(self) -> bool:
        """Return whether the picture that is wanted has not been asked for."""
        last = self._asked
        return bool(self._view) and (not last or last.scene != self._scene or last.view != self._view)

    @property
    def _unseen(self) -> bool:
        """Return whether a picture was asked for, and nothing of it has arrived yet."""
        return self._asked is not None and self._asked.running and not self._asked.seen

    @property
    def _exported(self) -> bool:
        """Return whether an exported scene has not been asked for yet."""
        return bool(self._scene) and not (self._asked and self._asked.scene == self._scene)

    @property
    def _may_export(self) -> bool:
        """Return whether there are changes to export, and this is the moment for it."""
        return bool(self._scenes) and self._exporting and not self._unseen and not self._exported

    @property
    def _waits(self) -> bool:
        """Return whether a message from the engine or from the writer is expected."""
        if self._failed or not self._session:
            return False
        return not self._scenes or self._exporting or self._differs or (self._asked is not None and self._asked.running)

    def _tick(self) -> float | None:
        with self._boundary("tick"):
            if self._session:
                self._hear()
            if self._scenes:
                self._ask()
            if self._session and self._session.folder and (not self._scenes or self._may_export):
                self._redraw()  # `draw` has the context that an export needs
        return TICK_SECONDS if self._waits else None

    def _hear(self) -> None:
        """Handle the engine's events."""
        picture, stage = None, ""
        assert self._session
        while event := self._session.poll(0):
            kind, last = event["event"], self._asked
            if event.get("id", 0) not in {last and last.number, None}:
                continue  # of a command that was cancelled
            if kind == "error" and event["id"] is None:
                raise session.EngineError(f"Light Meshes: {event['message']}")
            if kind == "picture":
                picture = event
            elif kind == "progress":
                stage = event["stage"]
            elif kind in session.LAST_EVENTS:
                assert last and self._scenes
                last.running = False
                self._scenes.only(last.scene)
                if kind == "done":
                    self._lost = 0
                    self.statistics = event["statistics"]
                    self._say(summary(self.statistics))
                elif kind == "error":
                    picture = None
                    self._refused(event["message"])
        if picture:
            self._show(picture)
        if stage and self._asked and self._asked.running and time.monotonic() - self._told > TELL_SECONDS:
            self._told = time.monotonic()  # not more often: it makes Blender draw the view again
            self._say(stage)

    def _refused(self, message: str) -> None:
        """Show why the engine cannot make the picture that was asked for. The engine goes on running."""
        self._picture.clear()
        if not (self._exporting or self._differs):
            self._failed = True
        assert self._session
        self._tell(engine_python.lacks_package(self._session.python, message) or f"Light Meshes: {message}")

    def _show(self, event: dict) -> None:
        last = self._asked
        assert last and self._scenes
        if not last.seen:
            last.seen = True
            self._scenes.only(last.scene)
        # Copy it as a whole, because the engine will write there again.
        pixels = np.load(last.scene.with_name("view") / str(event["step"]) / "Combined.npy")
        self._picture.put(pixels, last.view.corners)
        self.pictures += 1
        self._redraw()

    def _say(self, text: str) -> None:
        """Show `text` in the view, in the line at its top, which has room only for short texts."""
        engine = self._engine()
        if text != self._text and engine:
            self._text = text
            engine.update_stats("", "Failed" if self._failed else text)
            engine.tag_redraw()

    def _redraw(self) -> None:
        engine = self._engine()
        if engine:
            engine.tag_redraw()

    @contextmanager
    def _boundary(self, what: str):
        """Measure the time of a block, and turn every exception into one sentence for the artist."""
        start, busy = time.perf_counter(), time.thread_time()
        try:
            yield
        except ReferenceError:  # Blender has removed the engine
            self.end()
        except Exception as e:
            self._weigh(e)
            e.__traceback__ = None  # its frames would keep the engine object, and with it the process, alive
        finally:
            took = time.perf_counter() - start, time.thread_time() - busy
            before = self.longest.get(what, took)
            self.longest[what] = max(took[0], before[0]), max(took[1], before[1])

    def _weigh(self, error: Exception) -> None:
        if isinstance(error, session.EngineGone):
            self._begin_anew(error)
        elif self._session and self._session.ends_within(ENDING_SECONDS):
            self._begin_anew(self._session.gone())  # its files are gone too
        elif isinstance(error, ExportError | session.EngineError):
            self._fail(str(error), getattr(error, "log", ""))
        else:
            self._fail(f"The Light Meshes add-on failed: {type(error).__name__}: {error}", traceback.format_exc())

    def _begin_anew(self, why: session.EngineError) -> None:
        """Start another engine because this one has ended, unless this has happened several times in a row."""
        if self._lost == RESTARTS or not isinstance(why, session.EngineGone):
            self._fail(str(why), why.log)
            return
        self._lost += 1
        self._leave(session.Session.kill)
        self._tell(f"{why}. Another one is started", why.log)
        self._redraw()  # `draw` starts the new engine

    def _tell(self, message: str, log: str = "") -> None:
        """Show what went wrong in the view, and with more details in the console."""
        console.say(f"Light Meshes: {console.shown(message)}" + (f"\nThe end of the log:\n{log}" if log else ""))
        self._say(console.shown(message))

    def _fail(self, message: str, log: str) -> None:
        """Show the error, and do nothing more until something changes."""
        self._failed = True
        self._tell(message, log)
        self._leave(session.Session.kill)

    def _leave(self, how: Callable[[session.Session], None]) -> None:
        engine, scenes = self._session, self._scenes

        def leave(engine: session.Session) -> None:
            if scenes:
                scenes.close()  # close it first; otherwise it would write into a folder that the engine has removed
            how(engine)
        if engine:
            session.in_background(partial(leave, engine))
        self._session = self._scenes = self._scene = self._asked = None
        self._exporting, self._slice = True, SLICE_SECONDS
        self._picture.clear()  # otherwise it would stay below the overlays of the next shading


def summary(statistics: dict) -> str:
    """Describe a picture for the artist, short enough for a small view (one of four)."""
    line = f"{statistics['seconds']:.2f} s"
    if "h" not in statistics:
        return line
    radii = list(statistics.get("light_radii", {}).values())
    if len(radii) + statistics.get("sized_lamps", 0) < statistics["lights"]:  # others have the scene's r
        radii.append(statistics["r"])
    parts = dict.fromkeys(f"{r:.3g}" for r in (min(radii), max(radii))) if radii else {}
    return f"{line}, h {statistics['h']:.3g}" + (f", r {'–'.join(parts)}" if parts else "")


def end_all() -> None:
    """End all views, when the add-on is switched off."""
    for viewport in list(viewports):
        viewport.end()
