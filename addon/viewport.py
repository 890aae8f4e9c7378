"""A rendered 3D view: exports what changed, asks the engine for pictures, and draws the last one.

Blender calls `update` when data changed and `draw` whenever the region is drawn; between them a timer hears what
the engine says. Nothing here waits: an export goes on slice by slice, each with a redraw of its own.
"""

from __future__ import annotations

import time
import traceback
import weakref
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np

from . import console, screen, session, view
from .export import ExportError, camera
from .export.scenes import Scenes
from .export.snapshot import handing_over
from .export.walk import settings
from .job import summary, temporary_folder, threads

SLICE_SECONDS = 0.04  # of an export, between two redraws
TICK_SECONDS = 0.01  # how often the engine is listened to
PATIENCE_SECONDS = 1.0  # how long an edit waits for the first picture of what was before it
STEPS = [[8, 1], [4, 1], [2, 1], [1, 1]]  # divisor of the resolution, samples; then as many as a render takes

viewports: weakref.WeakSet[Viewport] = weakref.WeakSet()  # all that are open


@dataclass
class _Asked:
    """A command to the engine."""

    number: int
    scene: Path
    view: view.View
    sent: float = field(default_factory=time.monotonic)
    seen: bool = False  # it has given a picture
    running: bool = True


class Viewport:
    """The state of one 3D view. It has an engine of its own, so that renders go on beside it."""

    def __init__(self, engine) -> None:
        self._engine = weakref.ref(engine)
        self._session: session.Session | None = None
        self._scenes: Scenes | None = None
        self._exporting = False  # something has changed, and not all of it is taken in
        self._scene: Path | None = None  # the last that was taken in
        self._samples = 1
        self._threads: int | None = None
        self._home: dict | None = None  # the camera that h is measured with where the scene has none
        self._view: view.View | None = None
        self._asked: _Asked | None = None
        self._picture = screen.Picture()
        self._text = ""
        self._failed = False
        self._timer = self._tick  # one object, as Blender's timers know functions by their identity
        self.longest: dict[str, tuple[float, float]] = {}  # for which Blender was kept: seconds, and its own of them
        self.pictures = 0
        self.statistics: dict = {}  # of the last picture that was finished
        viewports.add(self)

    def update(self, context, depsgraph) -> None:
        """Data changed, or this is the beginning."""
        with self._boundary("update"):
            self._failed = False
            self._exporting = True
            if self._scenes:
                self._scenes.note(depsgraph)
            self._go_on(context, depsgraph)

    def draw(self, context, depsgraph) -> None:
        """Draw the last picture, and have the next one made if the view is another."""
        with self._boundary("draw"):
            if not self._failed:
                self._go_on(context, depsgraph)
            self._picture.draw(self._engine(), depsgraph.scene)

    def end(self) -> None:
        """End the engine, without waiting."""
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)
        viewports.discard(self)
        self._leave(session.Session.end)

    def _go_on(self, context, depsgraph) -> None:
        if not self._session:
            session.set_temporary(temporary_folder())
            self._session = session.Session(session.engine_python(), polite=True)
            self._say("Starting the engine")
        if self._session.folder and not self._scenes:
            with handing_over():
                self._scenes = Scenes(self._session.new_folder())
            self._scenes.note(depsgraph)
            self._exporting = True
        self._view = view.current(context, depsgraph.scene, depsgraph)
        if self._scenes and self._exporting:
            self._export(context, depsgraph)
        self._ask()
        if self._waits and not bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.register(self._timer, first_interval=TICK_SECONDS)

    def _export(self, context, depsgraph) -> None:
        space, scene = context.space_data, depsgraph.scene_eval
        if not scene.camera and not self._home and self._view:
            self._home = self._view.camera

        def eye(report):
            # What h is measured with: the camera of renders, so that the view has their shadows from all sides.
            found = camera.frame(view.Final(scene), scene, depsgraph, report) if scene.camera else self._home
            return found | {"crop": None}

        with handing_over():
            path = self._scenes.advance(depsgraph, SLICE_SECONDS, eye, lambda ob: ob.visible_in_viewport_get(space))
        if path:
            self._scene, self._exporting = path, False
            self._samples = settings(scene, depsgraph.view_layer_eval)["samples"]
            self._threads = threads(scene)
        else:
            self._say("Exporting the scene")
            self._engine().tag_redraw()

    def _ask(self) -> None:
        """Ask for the picture that is wanted, unless it has been asked for, or the time has not come."""
        last = self._asked
        if self._exporting or not (self._scene and self._view and self._scenes.written()) or not self._differs:
            return
        if last and last.running:
            # Who turns the view without a pause is to see something too: the first picture may come.
            if not last.seen and (last.scene == self._scene or time.monotonic() - last.sent < PATIENCE_SECONDS):
                return
            self._session.ask_to_cancel(last.number)
        steps = STEPS + ([[1, self._samples]] if self._samples > 1 else [])
        number = self._session.send(
            "view", snapshot=str(self._scene), framebuffer=str(self._scene.with_name("view")),
            camera=self._view.camera, passes=["Combined"], steps=steps, threads=self._threads)
        self._asked = _Asked(number, self._scene, self._view)
        self._say("Rendering")

    @property
    def _differs(self) -> bool:
        """Whether what is wanted has not been asked for."""
        last = self._asked
        return not last or last.scene != self._scene or last.view != self._view

    @property
    def _waits(self) -> bool:
        """Whether the engine or the writer is to be heard of."""
        if self._failed or not self._session:
            return False
        return not self._scenes or self._asked is None or self._asked.running or self._differs

    def _tick(self) -> float | None:
        with self._boundary("tick"):
            self._hear()
            if self._session.folder and not self._scenes:
                self._engine().tag_redraw()  # `draw` has what an export needs
            elif self._scenes:
                self._ask()
        return TICK_SECONDS if self._waits else None

    def _hear(self) -> None:
        """Take in what the engine said."""
        picture = None
        while event := self._session.poll(0):
            kind, last = event["event"], self._asked
            if kind == "compiling":
                self._say(event["stage"])
            if event.get("id", 0) not in {last and last.number, None}:
                continue  # of a command that was cancelled
            if kind == "error":
                raise session.EngineError(session.lacks_package(self._session.python, event["message"])
                                          or f"Light Meshes: {event['message']}")
            if kind == "picture":
                picture = event
            elif kind in session.LAST_EVENTS:
                last.running = False
                self._scenes.only(last.scene)
                if kind == "done":
                    self.statistics = event["statistics"]
                    self._say(summary(self.statistics))
        if picture:
            self._show(picture)

    def _show(self, event: dict) -> None:
        last = self._asked
        if not last.seen:
            last.seen = True
            self._scenes.only(last.scene)
        # Read as a whole: the engine will write there again.
        pixels = np.load(last.scene.with_name("view") / str(event["step"]) / "Combined.npy")
        self._picture.put(pixels, last.view.corners)
        self.pictures += 1
        self._engine().tag_redraw()

    def _say(self, text: str) -> None:
        """Show `text` in the view."""
        engine = self._engine()
        if text != self._text and engine:
            self._text = text
            engine.update_stats("", text)
            engine.tag_redraw()

    @contextmanager
    def _boundary(self, what: str):
        """Measures the time, and makes one sentence for the artist of whatever goes wrong."""
        start, busy = time.perf_counter(), time.thread_time()
        try:
            yield
        except ReferenceError:  # Blender has removed the engine
            self.end()
        except (ExportError, session.EngineError) as e:
            self._fail(str(e), getattr(e, "log", ""))
        except Exception as e:
            self._fail(f"The Light Meshes add-on failed: {type(e).__name__}: {e}", traceback.format_exc())
        finally:
            took = time.perf_counter() - start, time.thread_time() - busy
            self.longest[what] = tuple(map(max, took, self.longest.get(what, took)))

    def _fail(self, message: str, log: str) -> None:
        """Say it, and do nothing more until something changes."""
        self._failed = True
        console.say(f"Light Meshes: {console.shown(message)}" + (f"\nThe end of the log:\n{log}" if log else ""))
        self._say(console.shown(message))
        self._leave(session.Session.kill)

    def _leave(self, how: Callable[[session.Session], None]) -> None:
        engine, scenes = self._session, self._scenes

        def leave():
            if scenes:
                scenes.close()  # first, or it would write where the engine has removed everything
            how(engine)
        if engine:
            session.in_background(leave)
        self._session = self._scenes = self._scene = self._asked = None


def end_all() -> None:
    """The add-on is switched off."""
    for viewport in list(viewports):
        viewport.end()
