"""All shadow methods by their names: who wants to know what a method can, or to make one, asks here.

The name in `scene.description.SHADOWS` is also that of the method's file: LIGHT_MESHES stands in `light_meshes.py`, as
its `KIND`. So a new method is a new file, and its name there.
"""

from __future__ import annotations

from importlib import import_module

from ..scene.description import SHADOWS, Settings
from . import unshadowed
from .method import Kind

NONE = "NONE"  # what the plan says where there are no shadows at all; no choice of the artist's
KINDS: dict[str, Kind] = {NONE: unshadowed.KIND} | {
    name: import_module(f".{name.lower()}", __package__).KIND for name in SHADOWS}


def check(settings: Settings) -> None:
    """Raise SceneError unless the shadow method has the settings that it is given for itself."""
    KINDS[settings.shadows].own(settings)
