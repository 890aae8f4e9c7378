"""Names and values from outside, as messages show them: in one line, short, and without what steers a terminal."""

from __future__ import annotations

import reprlib
from typing import Any


def shown(text: str) -> str:
    """`text` in one line, what is no letter or sign of it as escapes: they could steer a terminal, or turn its text."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


_short = reprlib.Repr()
_short.maxstring = _short.maxother = 80


def quoted(value: Any) -> str:
    """A value from outside as a message quotes it: in one line, and short whatever it is."""
    text = _short.repr(value)
    return text if len(text) <= 100 else f"{text[:97]}..."
