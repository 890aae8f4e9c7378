"""The signals that end the command, and moments in which they wait: what is made then is known before it must go."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator

_waits = 0
_came = False


def listen() -> None:
    """From now on Ctrl-C, a farm's cancel and a closed terminal raise KeyboardInterrupt; nohup has the last ignored."""
    for each in _signals():
        signal.signal(each, _interrupt)


@contextlib.contextmanager
def waiting() -> Iterator[None]:
    """Signals that come meanwhile raise at the end. Use it inside of the `try` that clears away what is made in it."""
    global _waits
    _waits += 1
    try:
        yield
    finally:
        _waits -= 1
    if _came and not _waits:
        _raise()


def _signals() -> list[int]:
    known = (getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
    return [each for each in known if signal.getsignal(each) != signal.SIG_IGN]


def _interrupt(*_: object) -> None:
    global _came
    _came = True
    if not _waits:
        _raise()


def _raise() -> None:
    global _came
    _came = False
    for each in _signals():  # once is enough: what is left behind is cleared away now
        signal.signal(each, signal.SIG_IGN)
    raise KeyboardInterrupt
