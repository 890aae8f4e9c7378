"""Handle the signals that end the command, and delay them in critical moments, so that files and processes that are
being made can be cleaned up.
"""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator

_waits = 0
_came = False


def listen() -> None:
    """Let Ctrl-C, the cancel signal of a farm, and a closed terminal raise KeyboardInterrupt from now on. With nohup a
    closed terminal is ignored.
    """
    for each in _signals():
        signal.signal(each, _interrupt)


@contextlib.contextmanager
def waiting() -> Iterator[None]:
    """Delay signals: those that arrive meanwhile raise at the end. Use it inside the `try` that cleans up what is made
    in it.
    """
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
    for each in _signals():  # one signal is enough: the cleaning up must not be interrupted
        signal.signal(each, signal.SIG_IGN)
    raise KeyboardInterrupt
