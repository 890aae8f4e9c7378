"""All shadow methods by name. Code that needs to know what a method can do, or that makes one, uses this module.

A name in `scene.description.SHADOWS` is also the name of the method's file: LIGHT_MESHES is in `light_meshes.py`, as
its `KIND`. So a new method needs a new file, and its name there.
"""

from __future__ import annotations

from importlib import import_module

from ..scene.description import SHADOWS, Settings
from . import unshadowed
from .method import Kind

NONE = "NONE"  # the plan's name for no shadows at all; the artist cannot choose it
KINDS: dict[str, Kind] = {NONE: unshadowed.KIND} | {
    name: import_module(f".{name.lower()}", __package__).KIND for name in SHADOWS}


def check(settings: Settings) -> None:
    """Raise SceneError unless the given settings of the shadow method are its own."""
    KINDS[settings.shadows].own(settings)
