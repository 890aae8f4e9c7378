"""Format names and values from outside for messages: in one line, short, and without characters that control a
terminal.
"""

from __future__ import annotations

import reprlib
from typing import Any


def shown(text: str) -> str:
    """Return `text` as one line. Characters that cannot be printed are escaped, because they could control a terminal
    or reverse the text.
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


_short = reprlib.Repr()
_short.maxstring = _short.maxother = 80


def quoted(value: Any) -> str:
    """Return a value from outside as a message quotes it: on one line, and shortened."""
    text = _short.repr(value)
    return text if len(text) <= 100 else f"{text[:97]}..."
