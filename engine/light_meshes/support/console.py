"""What the command says to a terminal, a pipe or a file, whatever these can show, and whether or not they take it."""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import re
import sys
from typing import TextIO

from ..support.text import shown

# As libraries and the system's loader say it.
OUT_OF_MEMORY = re.compile(r"out of memory|MemoryError|bad_alloc|cannot allocate memory|failed to map segment|"
                           r"can't start new thread", re.IGNORECASE)
_PLAINER = {"×": "x", "…": "...", "█": "#", "░": ".", "²": "^2", "−": "-", "→": "->", "Ψ": "Psi", "Π": "Pi", "Σ": "sum"}
lost: OSError | None = None  # why something that was said did not arrive


def prepare() -> None:
    """Have all standard streams there, and none of them refuse a character."""
    with contextlib.suppress(OSError):
        while (number := os.open(os.devnull, os.O_RDWR)) < 3:  # closed: the next file would be it, also to children
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
    """Characters that the stream cannot show, in ones that all can."""
    if not isinstance(e, UnicodeEncodeError):
        raise e
    text = e.object[e.start:e.end]
    return "".join(_PLAINER.get(c) or c.encode("unicode_escape").decode() for c in text), e.end


def say(text: str, stream: TextIO | None = None) -> None:
    """Print lines on stdout, or another stream; what a name holds beside letters is shown as escapes."""
    write("\n".join(map(shown, text.split("\n"))) + "\n", stream or sys.stdout)


def write(text: str, stream: TextIO) -> None:
    """Write text as it is. That a stream does not take it must not end a render: `lost` tells."""
    global lost
    try:
        stream.write(text)
        stream.flush()
    except (OSError, ValueError) as e:
        if isinstance(e, OSError):
            lost = OSError(e.errno, e.strerror, "the standard output")
        _silence(stream)


def _silence(stream: TextIO) -> None:
    """Nothing more goes there: Python would try again at its end, and make its exit code 120."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
