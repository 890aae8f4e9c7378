"""What the add-on says on the console, whatever that can show; names in a file steer no terminal."""

import contextlib
import os


def shown(text: str) -> str:
    """`text` in one line, what is no letter or sign of it as escapes: they could steer a terminal, or turn its text."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def say(text: str) -> None:
    """Print lines. A console that is closed or full, or lacks letters, must not end a render."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        lines = "\n".join(map(shown, text.split("\n")))
        try:
            print(lines, flush=True)
        except UnicodeEncodeError:
            print(lines.encode("ascii", "backslashreplace").decode(), flush=True)


def keep_standard_streams() -> None:
    """Open those that are closed: else a pipe to the engine takes the number of one, and Blender writes to it."""
    with contextlib.suppress(OSError):
        while (number := os.open(os.devnull, os.O_RDWR)) < 3:
            pass
        os.close(number)
