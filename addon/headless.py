"""Render a .blend without a window, as the command line `light-meshes` has it done.

    python -m light_meshes_addon.headless render FILE.blend -o OUT.png|.exr [-f 1,3..8] [--resume] [--set key=value]…
    blender -b -P addon/headless.py -- snapshot FILE.blend -o FOLDER [-f N] [--set key=value]…

What a program wants to know is printed on lines of a mark, "@light-meshes " or what LIGHT_MESHES_MARK says, and JSON:
the events progress, wrote, kept (there already), warning, statistics, error, and end where all is done.
One that gives its temporary folder as LIGHT_MESHES_TEMPORARY answers "found", a picture that is there, by a line
"whole" or "broken" on stdin. When stdin closes it is gone: this process goes, with all in that folder and in --work.
Exit codes: 0 done, 1 failed, 2 bad usage.
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

MARK = "@light-meshes "  # a program that must not take anything else for ours gives another for each run
FRAMES = 1048574  # Blender has none beyond
RENDER_KEYS = ("resolution", "resolution_percentage")
_mark = MARK
_driven = False  # by a program, which answers
_answers: queue.Queue[str] = queue.Queue()


class UsageError(Exception):
    """The command makes no sense; exit code 2."""


class FailedError(Exception):
    """The command could not be carried out; exit code 1."""


def _listen(folders: list[Path]) -> None:
    """Hear answers, until the program that started us is gone: then `folders` and this process go as well."""
    with contextlib.suppress(OSError):
        for answer in os.fdopen(os.dup(0), "rb", buffering=0):
            _answers.put(answer.decode().strip())
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _is_whole(picture: Path) -> bool:
    """Whether a picture is there, and all of it: this the program that started us can tell."""
    if not picture.is_file() or not picture.stat().st_size:
        return False
    if not _driven:
        return True
    say(event="found", path=str(picture))
    return _answers.get() == "whole"


def say(**event) -> None:
    """Tell the program that started us."""
    print(_mark + json.dumps(event), flush=True)


def main(arguments: list[str]) -> int:
    """Carry a command out; the exit code."""
    global _mark, _driven
    _mark = os.environ.pop("LIGHT_MESHES_MARK", MARK)  # nobody else need know it
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
    """'1,3..8' or '1,3-8' → ranges of frame numbers."""
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
    """Where the picture of `frame` goes: #s are its number; else, of several, it comes before the suffix."""
    match = re.search(r"#+", output.name)
    if match:
        return output.with_name(output.name[:match.start()] + f"{frame:0{len(match[0])}d}" + output.name[match.end():])
    return output.with_name(f"{output.stem}_{frame:04d}{output.suffix}") if several else output


def _disable_others() -> None:
    """Of two copies of the add-on, the engine's name belongs to this one, whatever the user has enabled."""
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
                scene.light_meshes.auto_h = False  # whoever gives a step means it


def _value(prop, text: str):
    """`text` as a value of property `prop`."""
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
    if not image.file_format.startswith(file_format):  # an EXR of several layers stays one
        if hasattr(image, "media_type"):
            image.media_type = 'IMAGE'  # 5.0+
        image.file_format = file_format
    # Blender would append a suffix of its own choice, and read #s in a folder's name as the frame's number.
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
        # Under another name until it is whole: a picture that is there is a finished one.
        # Not longer than the picture's own, which may be as long as the file system takes.
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
    """`path` as Blender takes it: since 5.0 braces are templates, unless they are doubled."""
    import bpy

    text = str(path)
    return text.replace("{", "{{").replace("}", "}}") if bpy.app.version >= (5, 0) else text


def _check_place(path: Path, new: Path) -> None:
    """Before it is rendered: whether a picture can be written there, under that name."""
    try:
        new.touch()
        new.unlink()
        path.exists()  # which a name that is too long cannot be asked
    except OSError as e:
        raise FailedError(f"{path} cannot be written: {e.strerror}") from e


def _check_room(picture: Path) -> None:
    """Raise OSError where the disk is full: Blender writes half a picture there, and says nothing."""
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
    """Have something rendered, with what is said on the way passed on."""
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
    """Blender's own sentence in an operator's error."""
    return str(error).strip().removeprefix("Error: ").splitlines()[0]


def _this_package() -> str:
    """Import the folder of this script as a package: `blender -P` runs it as a lone file."""
    here = Path(__file__).resolve().parent
    name = "light_meshes_addon"
    spec = importlib.util.spec_from_file_location(name, here / "__init__.py", submodule_search_locations=[str(here)])
    assert spec and spec.loader
    sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])
    return name


def leave(code: int) -> NoReturn:
    """End the process with `code`."""
    for stream in filter(None, (sys.stdout, sys.stderr)):  # one that is closed is None
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    bpy = sys.modules.get("bpy")
    if bpy and not bpy.app.binary_path:
        # bpy as a Python module: 4.2 may crash and 4.5 may hang at exit once an add-on's engine has rendered.
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
