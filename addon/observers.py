"""A list of functions that hear the progress of a render, besides Blender. The headless driver adds one."""

from collections.abc import Callable

observers: list[Callable[[dict], None]] = []


def notify(**event) -> None:
    """Call all observers with the event."""
    for observer in observers:
        observer(event)
