"""The command `light-meshes`: render and inspect .blend files and snapshots.

Exit codes: 0 done, 1 failed, 2 wrong usage. An error is one sentence on stderr; --debug adds a traceback.
"""

from __future__ import annotations

import argparse
import errno
import re
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any, NoReturn

from . import __version__
from .scene.description import Scene
from .scene.errors import SceneError, UsageError
from .support import allocation, console, interrupts, processors, scratch
from .support.sources import KernelError
from .support.text import shown

FRAMES = 1048574  # Blender's largest frame number


class Progress:
    """A progress bar on stderr if that is a terminal; otherwise silent."""

    def __init__(self) -> None:
        self._terminal, self._last = sys.stderr.isatty(), 0.0

    def __call__(self, fraction: float, stage: str) -> None:
        """Show that `fraction` of `stage` is done."""
        now = time.monotonic()
        if self._terminal and (fraction >= 1 or now - self._last > 0.1):
            self._last = now
            bar = "█" * round(30 * fraction)
            console.write(f"\r{bar:░<30} {fraction:4.0%} {shown(stage)[:40]:<40}", sys.stderr)

    def clear(self) -> None:
        """Remove the bar."""
        if self._terminal:
            console.write("\r" + " " * 78 + "\r", sys.stderr)


def main(argv: list[str] | None = None) -> int:
    """Run the command and return its exit code."""
    console.prepare()
    arguments = _parser().parse_args(_attached(sys.argv[1:] if argv is None else argv))
    interrupts.listen()
    allocation.keep()
    try:
        arguments.run(arguments)
        return 0
    except (Exception, KeyboardInterrupt) as e:
        if arguments.debug:
            console.say(traceback.format_exc(), sys.stderr)
        console.say(f"light-meshes: {shown(_sentence(e))}", sys.stderr)
        return 2 if isinstance(e, UsageError) else 1


def _sentence(e: BaseException) -> str:
    if isinstance(e, KeyboardInterrupt):
        return "interrupted"
    if isinstance(e, SceneError | UsageError | KernelError):
        return str(e)
    if isinstance(e, MemoryError) or console.OUT_OF_MEMORY.search(f"{e} {e.__cause__} {e.__context__}"):
        return "out of memory: render fewer pixels, a larger h or fewer triangles"
    if isinstance(e, OSError):
        return f"{e.filename}: {e.strerror}" if e.filename else str(e)
    return f"{type(e).__name__}: {e} (--debug shows where)"


def _attached(argv: list[str]) -> list[str]:
    """Return `argv` with negative frames attached to their option, because argparse would take -2..-1 for another
    option.
    """
    joined: list[str] = []
    for word in argv:
        if joined and joined[-1] in ("-f", "--frames") and re.match(r"-[0-9]", word):
            joined[-1] = f"--frames={word}"
        else:
            joined.append(word)
    return joined


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        super().error(shown(message))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="light-meshes", description="Soft shadows from point lights, without noise.")
    parser.add_argument("--version", action="version", version=f"light-meshes {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    render = commands.add_parser("render", help="render a .blend file or a snapshot folder to a picture")
    render.add_argument("file", metavar="FILE.blend|SNAPSHOT", type=Path)
    render.add_argument("-o", "--output", metavar="OUT.png|.exr", type=Path, required=True,
                        help="#### stands for the frame number")
    render.add_argument("-f", "--frames", metavar="1,3..8", help="frames of a .blend; its current one otherwise")
    render.add_argument("-t", "--threads", metavar="N", type=_threads,
                        help="threads to render with; a .blend's own setting otherwise, or all processors")
    render.add_argument("--resume", action="store_true", help="leave out frames whose picture is there already")
    render.set_defaults(run=_render)
    inspect = commands.add_parser("inspect", help="say what a scene holds, what the plan decides, what is missing")
    inspect.add_argument("file", metavar="FILE.blend|SNAPSHOT", type=Path)
    inspect.set_defaults(run=_inspect)
    bench = commands.add_parser("bench", help="measure speed against error on the scenes of blend_scenes/")
    bench.add_argument("--out", metavar="FOLDER", type=Path, default=Path("benchmark"),
                       help="for table.txt, results.json and figures (default: %(default)s)")
    bench.add_argument("--quick", action="store_true", help="small pictures and few of them: about two minutes")
    bench.add_argument("--only", metavar="PART,…", help="S3, S5, S7, S8, cycles, errors, lamps, growth, rates, embree, "
                       "process, threads, decisions, release; or figures, from the results that FOLDER has")
    bench.add_argument("--release", metavar="PYTHON", default="",
                       help="the Python of an environment with an earlier release, to render the same frames with")
    bench.add_argument("--debug", action="store_true", help="show tracebacks")
    bench.set_defaults(run=_bench)
    _add_contest(commands)
    for command in (render, inspect):
        command.add_argument("--set", metavar="key=value", action="append", default=[], type=_setting,
                             help="a setting, such as shadows=SHARP, h=0.02, kI=4 or samples=16; a .blend also takes "
                                  "resolution=WxH")
        command.add_argument("--debug", action="store_true", help="show tracebacks and what Blender prints")
    return parser


def _add_contest(commands: Any) -> None:
    contest = commands.add_parser("contest", help="judge this engine beside Cycles on the scenes of "
                                  "blend_scenes/contest/")
    contest.add_argument("--out", metavar="FOLDER", type=Path, default=Path("contest"),
                         help="for scenes, pictures, contest.md and contest.json; what is there is not rendered again "
                              "(default: %(default)s)")
    contest.add_argument("--scenes", metavar="NAME,…", help="some of the eight")
    contest.add_argument("--size", metavar="WxH", default="1920x1080", help="of the pictures (default: %(default)s)")
    contest.add_argument("--levels", metavar="LEVEL,…", default="draft,balanced,fine", help="of this engine; "
                         "'': none (default: %(default)s)")
    contest.add_argument("--samples", metavar="N,…", default="1,2,4,8,16,32,64,128,256", help="of Cycles, each "
                         "with and without its denoiser; '': none, so that with --levels '' only references are made "
                         "(default: %(default)s)")
    contest.add_argument("--reference", metavar="N", type=int, default=4096, help="samples of Cycles' reference "
                         "(default: %(default)s)")
    contest.add_argument("--frame", metavar="N", type=int, default=10, help="of the still (default: %(default)s)")
    contest.add_argument("--flight", metavar="N", type=int, default=20, help="frames for the flicker; 0: none "
                         "(default: %(default)s)")
    contest.add_argument("--blender", metavar="PROGRAM", help="a Blender to render with, instead of bpy")
    contest.add_argument("--patience", metavar="SECONDS", type=float, default=3600.0,
                         help="after which a picture is given up (default: %(default)s)")
    contest.add_argument("--debug", action="store_true", help="show tracebacks")
    contest.set_defaults(run=_contest)


def _threads(text: str) -> int:
    if not re.fullmatch("[0-9]{1,4}", text) or not 1 <= int(text) <= processors.MOST:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1 to {processors.MOST}")
    return int(text)


def _setting(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals or not key or not value:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form key=value")
    return key, value


def _is_blend(path: Path) -> bool:
    if not path.exists():
        raise SceneError(f"{path} does not exist")
    if path.is_dir():
        return False
    if path.suffix.lower() != ".blend":
        raise UsageError(f"{path} is neither a .blend file nor a snapshot folder")
    return True


def _render(arguments: argparse.Namespace) -> None:
    from .film import images as film

    output: Path = arguments.output
    if output.suffix.lower() not in (".png", ".exr"):
        raise UsageError(f"'{output.name}': pictures are written as .png or .exr")
    frames = None if arguments.frames is None else frame_numbers(arguments.frames)
    started, progress = time.monotonic(), Progress()
    try:
        blend_file = _is_blend(arguments.file)
        if not blend_file and frames:
            raise UsageError("a snapshot is one frame: leave out -f")
        film.check_place(output.absolute())
        if blend_file:
            from .frontends import blend

            warnings, pictures, statistics = blend.render(
                arguments.file, output, arguments.frames, arguments.resume, arguments.threads, arguments.set, progress,
                arguments.debug)
        else:
            if arguments.resume and film.whole(output):
                warnings, pictures, statistics = [], {output: False}, {}
            else:
                warnings, statistics = _render_snapshot(arguments, progress)
                pictures = {output: True}
    finally:
        progress.clear()
    for warning in warnings:
        console.say(f"light-meshes: warning: {shown(warning)}", sys.stderr)
    if statistics:
        from .frontends import report

        console.say(report.summary(statistics))
    for picture in (path for path, rendered in pictures.items() if not rendered):
        console.say(shown(f"{picture} is there already"))
    if any(pictures.values()):
        rendered = ", ".join(str(path) for path, rendered in pictures.items() if rendered)
        console.say(shown(f"{rendered} in {time.monotonic() - started:.1f} s"))


def _render_snapshot(arguments: argparse.Namespace, progress: Progress) -> tuple[list[str], dict[str, Any]]:
    from .film import images as film
    from .film import passes
    from .picture import memory, render

    processors.tell(arguments.threads)
    scene = _changed(_read(arguments.file), arguments.set)
    names = passes.all_of(scene) if arguments.output.suffix.lower() == ".exr" else ("Combined",)
    film.check_channels(arguments.output.absolute(), names)
    memory.check(memory.before(scene, names))
    done = render.render(scene, film.Framebuffer.create(scene, names), progress=progress)
    film.write(done.frame, arguments.output, scene.to_rec709)
    return [*scene.warnings, *done.warnings], done.statistics


def _read(folder: Path) -> Scene:
    from .scene import snapshot

    return snapshot.read(folder)


def _changed(scene: Scene, changes: list[tuple[str, str]]) -> Scene:
    import dataclasses

    from .scene import snapshot

    settings = scene.settings
    try:
        for key, value in changes:
            settings = snapshot.with_setting(settings, key, value)
    except SceneError as e:
        raise UsageError(str(e)) from e
    return dataclasses.replace(scene, settings=settings)


def frame_numbers(text: str) -> list[range]:
    """Return the frames of a list. "1,3..8" means 1 and 3 to 8, as in Blender, and so does "1,3-8". Raises
    UsageError.
    """
    frames = []
    for part in text.split(","):
        match = re.fullmatch(r"(-?[0-9]{1,999})(?:(?:\.\.|-)(-?[0-9]{1,999}))?", part.strip())
        if not match:
            raise UsageError(f"-f {text}: '{part}' is not a frame or a range such as 3..8")
        low, high = int(match[1]), int(match[2] or match[1])
        if low > high:
            raise UsageError(f"-f {text}: the range {part} is empty")
        if max(-low, high) > FRAMES:
            raise UsageError(f"-f {text}: Blender's frames go from -{FRAMES} to {FRAMES}")
        frames.append(range(low, high + 1))
    return frames


def _inspect(arguments: argparse.Namespace) -> None:
    from .frontends import report

    if not _is_blend(arguments.file):
        _answer(report.describe(_changed(_read(arguments.file), arguments.set)))
        return
    from .frontends import blend

    with scratch.made(Path(tempfile.gettempdir())) as folder:
        blend.export(arguments.file, folder / "scene", arguments.set, arguments.debug)
        _answer(report.describe(_read(folder / "scene")))


def _answer(text: str) -> None:
    """Print the answer. It stops early if the reader closes the pipe."""
    console.say(text)
    if console.lost and console.lost.errno != errno.EPIPE:
        raise console.lost


def _bench(arguments: argparse.Namespace) -> None:
    from .bench import command, runs

    parts = arguments.only.split(",") if arguments.only else runs.QUICK_PARTS if arguments.quick else runs.PARTS
    if unknown := sorted({*parts} - {*runs.PARTS, "figures"}):
        raise UsageError(f"--only: there is no part '{unknown[0]}'; there are {', '.join(runs.PARTS)} and figures")
    command.run(arguments.out, arguments.quick, [p for p in parts if p != "figures"], arguments.release)


def _contest(arguments: argparse.Namespace) -> None:
    from .bench import contest

    names = tuple(arguments.scenes.split(",")) if arguments.scenes else contest.SCENES
    levels = tuple(filter(None, arguments.levels.upper().split(",")))
    for option, given, known in (("--scenes", names, contest.SCENES), ("--levels", levels, contest.LEVELS)):
        if unknown := [name for name in given if name not in known]:
            raise UsageError(f"{option}: there is no '{unknown[0].lower()}'; there are {', '.join(known).lower()}")
    size = re.fullmatch(r"([0-9]{1,5})[x×]([0-9]{1,5})", arguments.size)
    if not size or min(int(size[1]), int(size[2])) < 16:
        raise UsageError(f"--size: '{arguments.size}' is not a size such as 1920x1080, of 16 pixels or more")
    if not re.fullmatch(r"([1-9][0-9]{0,5}(,[1-9][0-9]{0,5})*)?", arguments.samples):
        raise UsageError(f"--samples: '{arguments.samples}' are not numbers such as 1,4,16")
    if arguments.reference < 1 or arguments.frame < 1 or arguments.flight < 0 or arguments.patience <= 0:
        raise UsageError("--reference, --frame and --patience are more than 0, and --flight is not less")
    contest.run(contest.Task(names, (int(size[1]), int(size[2])), levels,
                             tuple(sorted({int(n) for n in arguments.samples.split(",") if n})), arguments.reference,
                             arguments.frame, arguments.flight, arguments.blender, arguments.patience), arguments.out)


if __name__ == "__main__":
    sys.exit(main())
