"""Render a .blend file without a window; the command line `light-meshes` runs this program.

    python -m light_meshes_addon.headless render FILE.blend -o OUT.png|.exr [-f 1,3..8] [--resume] [--set key=value]…
    blender -b -P addon/headless.py -- snapshot FILE.blend -o FOLDER [-f N] [--set key=value]…

Results for the calling program are printed as lines that begin with a mark and go on with JSON. The mark is
"@light-meshes " or the value of LIGHT_MESHES_MARK. The events are: progress, wrote, kept (the picture existed already),
warning, statistics, error, and end when everything is done.

A calling program may set LIGHT_MESHES_TEMPORARY to its temporary folder. Then it must answer each event "found" (a
picture exists) with a line "whole" or "broken" on stdin. When stdin closes, the calling program has ended: then this
process removes that folder and the one of --work, and ends.

Exit codes: 0 done, 1 failed, 2 wrong usage.
"""

import argparse
import contextlib
import importlib
import importlib.util
import itertools
import json
import os
import queue
import re
import secrets
import shutil
import sys
import threading
from pathlib import Path
from typing import NoReturn

# a calling program sets a new mark for each run, so that it cannot mistake other output for an event
MARK = "@light-meshes "
FRAMES = 1048574  # Blender's largest frame number
RENDER_KEYS = ("resolution", "resolution_percentage")
_mark = MARK
_driven = False  # whether a program drives this one, and answers
_answers: queue.Queue[str] = queue.Queue()


class UsageError(Exception):
    """The arguments of the command are wrong; the exit code is 2."""


class FailedError(Exception):
    """The command could not be carried out; the exit code is 1."""


def _listen(folders: list[Path]) -> None:
    """Read answers from stdin until the calling program has ended; then remove `folders` and end this process."""
    with contextlib.suppress(OSError):
        for answer in os.fdopen(os.dup(0), "rb", buffering=0):
            _answers.put(answer.decode().strip())
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _is_whole(picture: Path) -> bool:
    """Return whether a picture exists and is complete. Only the calling program can check that it is complete."""
    if not picture.is_file() or not picture.stat().st_size:
        return False
    if not _driven:
        return True
    say(event="found", path=str(picture))
    return _answers.get() == "whole"


def say(**event) -> None:
    """Send an event to the calling program."""
    print(_mark + json.dumps(event), flush=True)


def main(arguments: list[str]) -> int:
    """Carry out a command and return the exit code."""
    global _mark, _driven
    _mark = os.environ.pop("LIGHT_MESHES_MARK", MARK)  # child processes do not need it
    temporary = os.environ.pop("LIGHT_MESHES_TEMPORARY", "")
    try:
        options = _parse(arguments)
        if temporary:
            _driven = True
            folders = [Path(temporary), *([options.work] if options.work else [])]
            threading.Thread(target=_listen, args=(folders,), daemon=True).start()
        _disable_others()
        addon = sys.modules[__package__]
        addon.register()
        try:
            _open(options.file)
            _set(options.set)
            {"render": _render, "snapshot": _snapshot}[options.command](options)
        finally:
            addon.unregister()
    except UsageError as e:
        say(event="error", message=str(e))
        return 2
    except FailedError as e:
        say(event="error", message=str(e))
        return 1
    say(event="end")
    return 0


class _Parser(argparse.ArgumentParser):
    def error(self, message):
        raise UsageError(message)


def _parse(arguments: list[str]):
    parser = _Parser(prog="headless")
    commands = parser.add_subparsers(dest="command", required=True)
    for name in ("render", "snapshot"):
        command = commands.add_parser(name)
        command.add_argument("file", type=Path)
        command.add_argument("-o", "--output", type=Path, required=True)
        command.add_argument("-f", "--frames", type=frames_of, default=[])
        command.add_argument("--resume", action="store_true")
        command.add_argument("--threads", type=int)
        command.add_argument("--work", type=Path)
        command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args(arguments)
    if options.command == "render" and options.output.suffix.lower() not in {".png", ".exr"}:
        raise UsageError(f"{options.output.name}: pictures are written as .png or .exr")
    if options.command == "snapshot" and sum(map(len, options.frames)) > 1:
        raise UsageError("a snapshot is of one frame")
    return options


def frames_of(text: str) -> list[range]:
    """Convert a text such as '1,3..8' or '1,3-8' to ranges of frame numbers."""
    frames = []
    for part in text.split(","):
        match = re.fullmatch(r"(-?[0-9]{1,999})(?:(?:\.\.|-)(-?[0-9]{1,999}))?", part.strip())
        if not match:
            raise UsageError(f"'{part}' is no frame: give numbers and ranges, such as 1,3..8")
        first, last = int(match[1]), int(match[2] or match[1])
        if max(-first, last) > FRAMES:
            raise UsageError(f"'{part}': Blender's frames go from -{FRAMES} to {FRAMES}")
        if first > last:
            raise UsageError(f"'{part}' holds no frame: ranges go upwards, such as 3..8")
        frames.append(range(first, last + 1))
    return frames


def path_of(output: Path, frame: int, several: bool) -> Path:
    """Return the path for the picture of `frame`. #s in `output` are replaced by the frame's number. If there are none
    and there are several frames, the number is put before the suffix.
    """
    match = re.search(r"#+", output.name)
    if match:
        return output.with_name(output.name[:match.start()] + f"{frame:0{len(match[0])}d}" + output.name[match.end():])
    return output.with_name(f"{output.stem}_{frame:04d}{output.suffix}") if several else output


def _disable_others() -> None:
    """Disable other copies of the add-on that the user has enabled, so that the engine's name belongs to this copy."""
    import addon_utils
    import bpy

    for name in list(bpy.context.preferences.addons.keys()):
        if name.split(".")[-1] == "light_meshes" and name != __package__:
            addon_utils.disable(name)


def _open(file: Path) -> None:
    import bpy

    if not file.is_file():
        raise FailedError(f"{file} does not exist")
    try:
        bpy.ops.wm.open_mainfile(filepath=str(file.resolve()))
    except RuntimeError as e:
        raise FailedError(f"{file} cannot be opened: {_reason(e)}") from e
    if not bpy.data.scenes or Path(bpy.data.filepath).resolve() != file.resolve():
        raise FailedError(f"{file} cannot be opened: it is no .blend file that this Blender reads")
    bpy.context.scene.render.engine = 'LIGHT_MESHES'


def _set(changes: list[str]) -> None:
    import bpy

    scene = bpy.context.scene
    own = {p.identifier: p for p in scene.light_meshes.bl_rna.properties if p.identifier not in {"rna_type", "name"}}
    for change in changes:
        key, equals, text = change.partition("=")
        if not equals or key not in {*own, *RENDER_KEYS}:
            raise UsageError(f"there is no setting '{key}'; there are: {', '.join([*own, *RENDER_KEYS])} "
                             "(given as key=value)")
        if key == "resolution":
            match = re.fullmatch(r"(\d+)[x×](\d+)", text)
            if not match or not all(4 <= int(n) <= 65536 for n in match.groups()):
                raise _bad(key, text, "such as 1920x1080")
            scene.render.resolution_x, scene.render.resolution_y = int(match[1]), int(match[2])
        elif key == "resolution_percentage":
            scene.render.resolution_percentage = _number(key, text, int, 1, 32767)
        else:
            setattr(scene.light_meshes, key, _value(own[key], text))
            if key == "h" and not any(c.startswith("auto_h=") for c in changes):
                scene.light_meshes.auto_h = False  # a step that is given on the command line must be used


def _value(prop, text: str):
    """Convert `text` to a value of property `prop`."""
    if prop.type == 'BOOLEAN':
        values = {"true": True, "1": True, "on": True, "false": False, "0": False, "off": False}
        if text.lower() not in values:
            raise _bad(prop.identifier, text, "true or false")
        return values[text.lower()]
    if prop.type == 'ENUM':
        if text.upper() not in prop.enum_items:
            raise _bad(prop.identifier, text, f"one of {', '.join(prop.enum_items.keys())}")
        return text.upper()
    return _number(prop.identifier, text, int if prop.type == 'INT' else float, prop.hard_min, prop.hard_max)


def _number(key: str, text: str, kind: type, low, high):
    try:
        value = kind(text)
    except ValueError:
        value = None
    if value is None or not low <= value <= high:
        what = "a whole number" if kind is int else "a number"
        raise _bad(key, text, f"{what} of {low:g} or more" if high > 1e9 else f"{what} from {low:g} to {high:g}")
    return value


def _bad(key: str, text: str, needed: str) -> UsageError:
    return UsageError(f"{key} cannot be '{text if len(text) < 100 else text[:97] + '...'}': it must be {needed}")


def _render(options) -> None:
    import bpy

    scene = bpy.context.scene
    frames = options.frames or [[scene.frame_current]]
    several = sum(map(len, frames)) > 1
    if options.threads:
        scene.render.threads_mode, scene.render.threads = 'FIXED', options.threads
    file_format = 'PNG' if options.output.suffix.lower() == ".png" else 'OPEN_EXR'
    image = scene.render.image_settings
    if not image.file_format.startswith(file_format):  # an EXR with several layers keeps this format
        if hasattr(image, "media_type"):
            image.media_type = 'IMAGE'  # 5.0+
        image.file_format = file_format
    # Otherwise Blender would append a suffix of its own choice, and replace #s in the folder's name by the frame's
    # number.
    scene.render.use_file_extension = False
    for frame in itertools.chain.from_iterable(frames):
        path = path_of(options.output, frame, several).resolve()
        if not path.parent.is_dir():
            raise FailedError(f"the folder {path.parent} does not exist")
        if path.is_dir():
            raise FailedError(f"{path} is a folder: remove it, or give the picture another name")
        if options.resume and _is_whole(path):
            say(event="kept", frame=frame, path=str(path))
            continue
        scene.frame_set(frame)
        # The picture has a temporary name until it is complete, so a picture that exists is a finished one. The
        # temporary name is not longer than the final one, which may have the file system's maximum length.
        new = (options.work or path.parent) / f".{secrets.token_hex(4)}{path.suffix.lower()}"
        scene.render.filepath = _literal(new)
        _check_place(path, new)
        try:
            _run(lambda: bpy.ops.render.render(write_still=True))
            _check_room(new)
            new.replace(path)
        except OSError as e:
            raise FailedError(f"{path} has not been written: is there room, and permission?") from e
        finally:
            new.unlink(missing_ok=True)
        say(event="wrote", frame=frame, path=str(path))


def _literal(path: Path) -> str:
    """Return `path` in the form that Blender needs: since 5.0 braces are templates unless they are doubled."""
    import bpy

    text = str(path)
    return text.replace("{", "{{").replace("}", "}}") if bpy.app.version >= (5, 0) else text


def _check_place(path: Path, new: Path) -> None:
    """Check before the render whether a picture can be written at `path`, and under the temporary name `new`."""
    try:
        new.touch()
        new.unlink()
        path.exists()  # raises OSError if the name is too long
    except OSError as e:
        raise FailedError(f"{path} cannot be written: {e.strerror}") from e


def _check_room(picture: Path) -> None:
    """Raise OSError if the disk is full. Otherwise Blender would write half a picture without an error."""
    with picture.open("r+b") as f:
        size = f.seek(0, os.SEEK_END)
        f.write(bytes(1 << 16))
        f.flush()
        os.fsync(f.fileno())
        f.truncate(size)


def _snapshot(options) -> None:
    import bpy

    from .render_engine import export_frame

    for frames in options.frames:
        bpy.context.scene.frame_set(frames[0])
    _run(lambda: export_frame(bpy.context.scene, options.output.resolve()))
    if not (options.output / "scene.json").is_file():
        raise FailedError(f"{options.output} has not been written: is there room, and permission?")
    say(event="wrote", frame=bpy.context.scene.frame_current, path=str(options.output.resolve()))


def _run(render) -> None:
    """Start a render, and pass its messages on."""
    from .observers import observers

    errors = []
    observers.append(lambda event: errors.append(event["message"]) if event["event"] == "error" else say(**event))
    try:
        render()
    except RuntimeError as e:
        raise FailedError(errors[0] if errors else _reason(e)) from e
    finally:
        observers.pop()
    if errors:
        raise FailedError(errors[0])


def _reason(error: RuntimeError) -> str:
    """Return Blender's own sentence from an operator's error."""
    return str(error).strip().removeprefix("Error: ").splitlines()[0]


def _this_package() -> str:
    """Import the folder of this script as a package, because `blender -P` runs it as a single file."""
    here = Path(__file__).resolve().parent
    name = "light_meshes_addon"
    spec = importlib.util.spec_from_file_location(name, here / "__init__.py", submodule_search_locations=[str(here)])
    assert spec and spec.loader
    sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])
    return name


def leave(code: int) -> NoReturn:
    """End the process with exit code `code`."""
    for stream in filter(None, (sys.stdout, sys.stderr)):  # a stream that is closed is None
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    bpy = sys.modules.get("bpy")
    if bpy and not bpy.app.binary_path:
        # With bpy as a Python module, 4.2 may crash and 4.5 may hang at exit after an add-on's engine has rendered.
        session_folder = Path(bpy.app.tempdir)
        if session_folder.name.startswith("blender_"):
            shutil.rmtree(session_folder, ignore_errors=True)
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    if __package__:
        leave(main(sys.argv[1:]))
    driver = importlib.import_module(f"{_this_package()}.headless")
    leave(driver.main(sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []))
