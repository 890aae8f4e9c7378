"""Print messages of the add-on on any console. Control characters in names from a file are escaped."""

import contextlib
import os


def shown(text: str) -> str:
    """Return `text` as one line. Characters that cannot be printed are escaped, because they could control a terminal
    or reverse the text.
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def say(text: str) -> None:
    """Print lines. This never raises: a console that is closed or full, or lacks characters, must not end a render."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        lines = "\n".join(map(shown, text.split("\n")))
        try:
            print(lines, flush=True)
        except UnicodeEncodeError:
            print(lines.encode("ascii", "backslashreplace").decode(), flush=True)


def keep_standard_streams() -> None:
    """Open standard streams that are closed. Otherwise a pipe to the engine would get the number of one, and Blender
    would write into it.
    """
    with contextlib.suppress(OSError):
        while (number := os.open(os.devnull, os.O_RDWR)) < 3:
            pass
        os.close(number)
