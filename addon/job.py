"""One render of one view layer: the requests to the engine, and the messages to Blender meanwhile."""

import re
import shutil
import time
from pathlib import Path

import bpy

from . import console, engine_python, observers, passes, session
from .cryptomatte import metadata
from .export import border, export
from .export.snapshot import handing_over
from .picture import Picture

ASK_SECONDS = 0.04  # how often Blender is asked whether the artist pressed ESC
SHOW_SECONDS = 0.5  # how often new tiles are shown
CONFIRM_SECONDS = 0.1  # how long a cancelled render may take to end before Blender goes on without it


class Cancelled(Exception):  # noqa: N818  no error: it is what the artist wants
    """The artist pressed ESC."""


class Job:
    """One render of one view layer. Use it as a context manager; it removes its files at the end."""

    def __init__(self, engine, depsgraph, purpose: str = session.RENDER) -> None:
        self.engine, self.depsgraph = engine, depsgraph
        self._purpose = session.PREVIEW if engine.is_preview else purpose
        self._session: session.Session | None = None
        self._folder: Path | None = None
        self._snapshots = 0
        self._asked = 0.0
        self._said = ""
        self._drawing: tuple[float, float] | None = None  # when drawing began, and the progress then
        self._warnings: dict[str, None] = {}

    def __enter__(self):
        return self

    def __exit__(self, *_) -> None:
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)
        if self.engine.is_preview:
            return  # for previews: the panel of a material shows what is not translated
        for sentence in self._warnings:
            self.engine.report({'WARNING'}, console.shown(sentence))
            observers.notify(event="warning", message=sentence)

    def export(self, overrides: dict[str, dict], folder: Path | None = None) -> None:
        """Write the snapshot of the current frame. `overrides` are as in `export.export`."""
        with handing_over():
            if not folder:
                # A new folder each time, because the engine may have mapped the older one.
                self._snapshots += 1
                folder = self._shared_folder() / f"scene-{self._snapshots}"
            self._say("Exporting the scene")
            self._snapshot = folder
            report = export(self.engine, self.depsgraph, folder, self.check, overrides)
        self._lights = report.lights
        self._warnings.update(dict.fromkeys(report.sentences))
        self._mattes = report.mattes

    def measure(self) -> dict:
        """Ask the engine for the step "h" of the exported snapshot, and for the "radii" of lights whose size sets the
        width of their shadows' edges.

        A radius is None if nothing in the picture shows a shadow of the light.
        """
        self._say("Measuring the scene")
        found = self._carry_out(lambda event: None, "measure", snapshot=str(self._snapshot))
        return {"h": found["h"], "radii": {
            light: r for light, r in zip(self._lights, found["radii"], strict=True) if light}}

    def render(self) -> None:
        """Have the engine render the exported snapshot, and show the result."""
        engine, render = self.engine, self.depsgraph.scene.render
        assert self._session and self._folder, "nothing has been exported"
        frame = self._folder / "frame"
        crop = border(render, engine.resolution_x, engine.resolution_y)
        size = (crop[2] - crop[0], crop[3] - crop[1]) if crop else (engine.resolution_x, engine.resolution_y)
        picture = Picture(engine, size, self.depsgraph)
        if not engine.is_preview:
            layer = self.depsgraph.view_layer_eval
            self._warnings.update(dict.fromkeys(passes.missing(self.depsgraph.scene, layer)))
        # A preview is shown only when it is complete. Until then the artist sees the previous one, and none with holes.
        shows = not bpy.app.background and not engine.is_preview
        shown = time.monotonic()

        def on_event(event):
            nonlocal shown
            if event["event"] == "started":
                picture.open(frame)
            elif event["event"] == "progress":
                self._progress(**event)
            elif event["event"] == "tile" and shows and time.monotonic() - shown > SHOW_SECONDS:
                picture.show()
                shown = time.monotonic()

        try:
            self._session.keeps = render.use_persistent_data
            done = self._carry_out(on_event, "render", snapshot=str(self._snapshot), framebuffer=str(frame),
                                   passes=[p.engine_name for p in picture.passes], keep=self._session.keeps)
        except BaseException:
            picture.give_up()
            raise
        picture.end(metadata(self.depsgraph.view_layer_eval.name, self._mattes))
        self._finish(done)

    def check(self) -> None:
        """Raise Cancelled if the artist pressed ESC. This is cheap: it asks Blender only once in ASK_SECONDS."""
        now = time.monotonic()
        if now - self._asked > ASK_SECONDS:
            self._asked = now
            if self.engine.test_break():
                raise Cancelled

    def _shared_folder(self) -> Path:
        """Make a folder for this job inside the folder that is shared with the engine. The engine is started if
        necessary.
        """
        if not self._folder:
            self._say("Starting the engine")
            engine_python.set_temporary(temporary_folder())
            self._session = session.current(self._purpose)
            while not self._session.folder:
                self._poll()
            self._folder = self._session.new_folder()
        return self._folder

    def _carry_out(self, on_event, command: str, **arguments) -> dict:
        """Send a command, handle its events until it has ended, and return the last one."""
        assert self._session
        number = self._session.send(command, threads=threads(self.depsgraph.scene), **arguments)
        try:
            while True:
                event = self._poll()
                if not event or event.get("id") != number:
                    continue  # no event, or one of an earlier command that was cancelled
                if event["event"] == "error":
                    raise session.EngineError(engine_python.lacks_package(self._session.python, event["message"])
                                              or f"Light Meshes: {event['message']}", self._session.log)
                if event["event"] in session.LAST_EVENTS:
                    return event
                on_event(event)
        except BaseException:
            self._session.cancel(number, CONFIRM_SECONDS)
            raise

    def _poll(self) -> dict | None:
        self.check()
        assert self._session
        try:
            event = self._session.poll(ASK_SECONDS)
            if event and event["event"] == "error" and event["id"] is None:
                raise session.EngineError(f"Light Meshes: {event['message']}", self._session.log)
        except session.EngineError:
            session.discard(self._purpose)
            raise
        return event

    def _finish(self, done: dict) -> None:
        if self.engine.is_preview:
            return
        scene = self.depsgraph.scene
        session.statistics = {"scene": scene.name_full, "frame": scene.frame_current} | done["statistics"]
        self._warnings.update(dict.fromkeys(done["warnings"]))
        observers.notify(event="statistics", frame=self.depsgraph.scene.frame_current, statistics=done["statistics"])
        line = summary(done["statistics"])
        self._say(line)
        if bpy.app.background:
            console.say(f"Light Meshes: {line}")

    def _progress(self, event: str, fraction: float, stage: str, **_) -> None:
        self.engine.update_progress(fraction)
        self._say(re.sub(r", \d+ of .*", "", stage) if bpy.app.background else self._remaining(fraction, stage) + stage)
        if self.engine.is_preview:
            return
        observers.notify(event=event, frame=self.depsgraph.scene.frame_current, fraction=fraction, stage=stage)

    def _remaining(self, fraction: float, stage: str) -> str:
        """Return how long the render will still take, by the tiles that are done, as Blender shows times; empty at
        first.
        """
        if "tiles" not in stage:  # it is still being prepared
            self._drawing = None
            return ""
        now = time.monotonic()
        began, at = self._drawing = self._drawing or (now, fraction)
        if fraction <= at or now - began < SHOW_SECONDS:
            return ""
        minutes, seconds = divmod((now - began) * (1 - fraction) / (fraction - at), 60)
        return f"Remaining:{minutes:02.0f}:{seconds:05.2f} | "

    def _say(self, text: str) -> None:
        # In a window this updates the displayed time; in the background Blender would print a line for each.
        if text != self._said or not bpy.app.background:
            self._said = text
            self.engine.update_stats("", text)


def temporary_folder() -> str:
    """Return the folder where Blender keeps temporary files: the one in its preferences, or the system's."""
    # the folder of this Blender process, if Blender could make it; it is removed when Blender ends
    folder = Path(bpy.app.tempdir)
    return str(folder.parent if folder.name.startswith("blender_") else folder) if bpy.app.tempdir else ""


def threads(scene) -> int | None:
    """Return how many threads the engine should use, from Blender's setting or its option -t. None means all processors
    that it may use.
    """
    return scene.render.threads if scene.render.threads_mode == 'FIXED' else None


def summary(statistics: dict) -> str:
    """Describe a render in one line for the artist."""
    parts = ["{width}×{height} pixels, {triangles:,} triangles, " + (
        "{lights} light" if statistics["lights"] == 1 else "{lights} lights")]
    if statistics.get("nodes"):
        low, high = min(statistics["radii"]), max(statistics["radii"])  # of the lights with edges of one width
        r = f", r {low:.4g}{f' to {high:.4g}' if high > low else ''}"
        parts.append("h {h:.4g}" + (r if statistics.get("sized_lamps", 0) < statistics["lights"] else "") +
                     ", {nodes:,} nodes ({node_share:.1%}), {empty_sets} empty sets")
    parts.append("{seconds:.2f} s")
    if statistics.get("peak_memory"):  # not every system has this figure
        parts.append(f"{statistics['peak_memory'] / 1e6:.0f} MB")
    return ", ".join(parts).format_map(statistics)
