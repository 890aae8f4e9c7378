"""Which file an image has, and whether it may be opened. Nothing here has Blender open it."""

import os
import re
import stat
from pathlib import Path

import bpy

# Formats that Blender reads and the engine does not, by the first bytes of a file.
_FOREIGN = (b"\x00\x00\x00\x0cjP", b"\xff\x4f\xff\x51")  # JPEG 2000

# What is not opened.
_KINDS = {stat.S_IFDIR: "folder", stat.S_IFIFO: "named pipe", stat.S_IFSOCK: "socket", stat.S_IFCHR: "device",
          stat.S_IFBLK: "device"}


def path_of(image, user, frame: int) -> Path:
    """The file of `image` as the image user of a texture node shows it at `frame` of the scene."""
    path = bpy.path.abspath(image.filepath, library=image.library)
    if image.source == 'SEQUENCE':
        path = numbered(path, frame_of(user, frame))
    elif image.source == 'TILED' and image.tiles:
        first = image.tiles[0].number - 1001
        path = path.replace("<UDIM>", str(first + 1001)).replace("<UVTILE>", f"u{first % 10 + 1}_v{first // 10 + 1}")
    return Path(path)


def frame_of(user, frame: int) -> int:
    """The number of the picture that a sequence shows at `frame` of the scene."""
    length = user.frame_duration
    if not length:
        return 0
    n = frame - user.frame_start + 1
    if user.use_cyclic:
        n = (n - 1) % length + 1
    return min(max(n, 0), length) + user.frame_offset


def numbered(path: str, number: int) -> str:
    """`path` with another number: the last digits of the name before its suffix."""
    file = Path(path)
    found = re.fullmatch(r"(.*?)(\d+)(\D*)", file.stem, re.DOTALL)
    if not found:
        return path
    before, digits, after = found.groups()
    return str(file.with_name(f"{before}{max(number, 0):0{len(digits)}d}{after}{file.suffix}"))


def refusal(path: Path) -> str:
    """Why the file must not be opened, or an empty string: opening a pipe would wait for ever, a device as well."""
    try:
        real = path.resolve()
        mode = real.stat().st_mode
    except (OSError, RuntimeError, ValueError) as e:  # RuntimeError: links in a circle; ValueError: a NUL
        reason = getattr(e, "strerror", "") or "its path is not valid"
        return f"cannot be read ({reason[0].lower()}{reason[1:]})"
    kind = _KINDS.get(stat.S_IFMT(mode))
    if kind:
        return f"is a {kind}"
    if str(real).startswith(("/proc/", "/sys/")):
        return "is the system's own"
    return "" if os.access(real, os.R_OK) else "cannot be read (permission denied)"


def engine_reads(path: Path) -> bool:
    """Whether the file, which may be opened, is of a format that the engine reads."""
    with path.open("rb") as f:
        return not f.read(8).startswith(_FOREIGN)
