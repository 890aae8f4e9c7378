"""Print what the command says to a terminal, a pipe or a file, whatever characters they support, and even if they are
closed or full.
"""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import re
import sys
from typing import TextIO

from ..support.text import shown

# Texts of libraries and of the system's loader.
OUT_OF_MEMORY = re.compile(r"out of memory|MemoryError|bad_alloc|cannot allocate memory|failed to map segment|"
                           r"can't start new thread", re.IGNORECASE)
_PLAINER = {"×": "x", "…": "...", "█": "#", "░": ".", "²": "^2", "−": "-", "→": "->", "Ψ": "Psi", "Π": "Pi", "Σ": "sum"}
lost: OSError | None = None  # the reason why some output was lost


def prepare() -> None:
    """Make sure that all standard streams exist, and that none of them rejects a character."""
    with contextlib.suppress(OSError):
        # a closed stream: otherwise the next file that is opened would get its number, also in child processes
        while (number := os.open(os.devnull, os.O_RDWR)) < 3:
            os.set_inheritable(number, True)
        os.close(number)
    codecs.register_error("plainer", _plainer)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="plainer")


def _plainer(e: UnicodeError) -> tuple[str, int]:
    """Replace characters that the stream cannot encode by ASCII characters."""
    if not isinstance(e, UnicodeEncodeError):
        raise e
    text = e.object[e.start:e.end]
    return "".join(_PLAINER.get(c) or c.encode("unicode_escape").decode() for c in text), e.end


def say(text: str, stream: TextIO | None = None) -> None:
    """Print lines on stdout, or another stream. Characters in names that cannot be printed are escaped."""
    write("\n".join(map(shown, text.split("\n"))) + "\n", stream or sys.stdout)


def write(text: str, stream: TextIO) -> None:
    """Write text unchanged. If the stream fails, the render goes on and `lost` keeps the error."""
    global lost
    try:
        stream.write(text)
        stream.flush()
    except (OSError, ValueError) as e:
        if isinstance(e, OSError):
            lost = OSError(e.errno, e.strerror, "the standard output")
        _silence(stream)


def _silence(stream: TextIO) -> None:
    """Discard everything that is written there from now on. Otherwise Python would try again when it exits, and end
    with exit code 120.
    """
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
