"""What the engine says: a line of its output → a checked event, as the engine's `service` module describes them.

Knows nothing of Blender. Whatever comes out of the engine's process is read here, so nothing else need doubt it.
"""

import json
from pathlib import Path

LAST = {"done", "measured", "cancelled", "error"}  # each command ends with one of these
LONGEST = 2**24  # characters of a line; what is longer comes in parts, of which none is an event
_START = '{"event": "'


def read(line: str) -> dict | None:
    """The event in `line`, or None where it is none, or one that nobody here waits for.

    One that is not as it should be becomes an error of no command: whoever waits for it would wait for ever.
    """
    try:
        # What a library printed without ending its line stands in front.
        event = json.loads(line[max(line.find(_START), 0):])
    except (ValueError, RecursionError):
        return None
    if not isinstance(event, dict) or not isinstance(event.get("event"), str) or event["event"] not in _CONTENTS:
        return None
    try:
        if all(is_right(event[key]) for key, is_right in _CONTENTS[event["event"]].items()):
            return event
    except (KeyError, OSError, ValueError):  # no such entry; a path that no system takes
        pass
    return {"event": "error", "id": None, "message": f"the engine's event '{event['event']}' is not as this add-on "
            "knows it; are both of the same release?"}


def _whole(value) -> bool:
    return type(value) is int and 0 <= value < 2**53


def _text(value) -> bool:
    return isinstance(value, str)


def _number(value) -> bool:
    return type(value) in {int, float} and abs(value) < 1e300  # no NaN, no infinity


def _share(value) -> bool:
    return _number(value) and 0 <= value <= 1


def _length(value) -> bool:
    return _number(value) and value >= 0


def _folder(value) -> bool:
    """One that an engine made. It is removed when the engine has ended, so nothing else will do."""
    return _text(value) and Path(value).name.startswith("light-meshes-") and Path(value).is_dir()


def _lengths(value) -> bool:
    return isinstance(value, list) and all(v is None or _length(v) for v in value)


def _sentences(value) -> bool:
    return isinstance(value, list) and all(map(_text, value))


def _statistics(value) -> bool:
    """With what `job.summary` always tells."""
    return isinstance(value, dict) and all(
        _number(value.get(key)) for key in ("width", "height", "triangles", "lights", "seconds"))


# Event → what of it is used here, and what that must be.
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
