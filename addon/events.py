"""Read the engine's output: turn each line into a checked event, as described in the engine's `service` module.

This module does not use Blender. All output of the engine's process is read and checked here, so no other module needs
to check it.
"""

import json
from pathlib import Path

LAST = {"done", "measured", "cancelled", "error"}  # each command ends with one of these events
LONGEST = 2**24  # characters in a line; a longer line arrives in parts, and none of these is an event
_START = '{"event": "'


def read(line: str) -> dict | None:
    """Return the event in `line`, or None if it contains no event, or an event that the add-on does not use.

    A malformed event becomes an error that belongs to no command, because whoever waits for this event would wait for
    ever.
    """
    try:
        # A library may have printed something before it on the same line, without a line end.
        event = json.loads(line[max(line.find(_START), 0):])
    except (ValueError, RecursionError):
        return None
    if not isinstance(event, dict) or not isinstance(event.get("event"), str) or event["event"] not in _CONTENTS:
        return None
    try:
        if all(is_right(event[key]) for key, is_right in _CONTENTS[event["event"]].items()):
            return event
    except (KeyError, OSError, ValueError):  # no such entry; or a path that the system does not accept
        pass
    return {"event": "error", "id": None, "message": f"the engine's event '{event['event']}' is not as this add-on "
            "knows it; are both of the same release?"}


def _whole(value) -> bool:
    return type(value) is int and 0 <= value < 2**53


def _text(value) -> bool:
    return isinstance(value, str)


def _number(value) -> bool:
    return type(value) in {int, float} and abs(value) < 1e300  # neither NaN nor infinity


def _share(value) -> bool:
    return _number(value) and 0 <= value <= 1


def _length(value) -> bool:
    return _number(value) and value >= 0


def _folder(value) -> bool:
    """Return `value` as a path if it is a folder that an engine made. It is removed when the engine has ended, so no
    other folder may be accepted.
    """
    return _text(value) and Path(value).name.startswith("light-meshes-") and Path(value).is_dir()


def _lengths(value) -> bool:
    return isinstance(value, list) and all(v is None or _length(v) for v in value)


def _sentences(value) -> bool:
    return isinstance(value, list) and all(map(_text, value))


def _statistics(value) -> bool:
    """Return `value` if it has the entries that `job.summary` needs."""
    return isinstance(value, dict) and all(
        _number(value.get(key)) for key in ("width", "height", "triangles", "lights", "seconds"))


# For each event: the entries that are used here, and the check that each must pass.
_CONTENTS = {
    "ready": {"folder": _folder},
    "started": {"id": _whole},
    "progress": {"id": _whole, "fraction": _share, "stage": _text},
    "tile": {"id": _whole},
    "picture": {"id": _whole, "step": _whole},
    "done": {"id": _whole, "statistics": _statistics, "warnings": _sentences},
    "measured": {"id": _whole, "h": _length, "radii": _lengths},
    "cancelled": {"id": _whole},
    "error": {"id": lambda value: value is None or _whole(value), "message": _text},
    "alive": {},
}
