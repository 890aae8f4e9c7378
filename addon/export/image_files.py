"""Find the file of an image, and check whether it may be opened. Nothing here makes Blender open it."""

import os
import re
import stat
from pathlib import Path

import bpy

# Formats that Blender reads and the engine does not, by the first bytes of the file.
_FOREIGN = (b"\x00\x00\x00\x0cjP", b"\xff\x4f\xff\x51")  # JPEG 2000

# Kinds of files that are not opened.
_KINDS = {stat.S_IFDIR: "folder", stat.S_IFIFO: "named pipe", stat.S_IFSOCK: "socket", stat.S_IFCHR: "device",
          stat.S_IFBLK: "device"}


def path_of(image, user, frame: int, tile: int = 0) -> Path:
    """Return the file of `image` that the image user of a texture node shows at `frame` of the scene.

    `tile` is the number of a UDIM tile, or 0 for the first.
    """
    path = bpy.path.abspath(image.filepath, library=image.library)
    if image.source == 'SEQUENCE':
        path = numbered(path, frame_of(user, frame))
    elif image.source == 'TILED' and image.tiles:
        n = (tile or image.tiles[0].number) - 1001
        path = path.replace("<UDIM>", str(n + 1001)).replace("<UVTILE>", f"u{n % 10 + 1}_v{n // 10 + 1}")
    return Path(path)


def frame_of(user, frame: int) -> int:
    """Return the number of the picture in a sequence that is shown at `frame` of the scene."""
    length = user.frame_duration
    if not length:
        return 0
    n = frame - user.frame_start + 1
    if user.use_cyclic:
        n = (n - 1) % length + 1
    return min(max(n, 0), length) + user.frame_offset


def numbered(path: str, number: int) -> str:
    """Return `path` with another number in place of the last digits of the name before its suffix."""
    file = Path(path)
    found = re.fullmatch(r"(.*?)(\d+)(\D*)", file.stem, re.DOTALL)
    if not found:
        return path
    before, digits, after = found.groups()
    return str(file.with_name(f"{before}{max(number, 0):0{len(digits)}d}{after}{file.suffix}"))


def refusal(path: Path) -> str:
    """Return why the file must not be opened, or an empty string. Opening a pipe or a device could block for ever."""
    try:
        real = path.resolve()
        mode = real.stat().st_mode
    except (OSError, RuntimeError, ValueError) as e:  # RuntimeError: a circle of links; ValueError: a NUL in the name
        reason = getattr(e, "strerror", "") or "its path is not valid"
        return f"cannot be read ({reason[0].lower()}{reason[1:]})"
    kind = _KINDS.get(stat.S_IFMT(mode))
    if kind:
        return f"is a {kind}"
    if str(real).startswith(("/proc/", "/sys/")):
        return "is the system's own"
    return "" if os.access(real, os.R_OK) else "cannot be read (permission denied)"


def engine_reads(path: Path) -> bool:
    """Return whether the engine can read the format of the file, which must be safe to open."""
    with path.open("rb") as f:
        return not f.read(8).startswith(_FOREIGN)
