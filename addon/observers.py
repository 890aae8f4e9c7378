"""Who wants to hear of a render's progress, beside Blender: the headless driver does."""

from collections.abc import Callable

observers: list[Callable[[dict], None]] = []


def notify(**event) -> None:
    """Tell all observers."""
    for observer in observers:
        observer(event)
