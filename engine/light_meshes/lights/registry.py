"""All types of light by their names, and their numbers in the kernels.

The name in `scene.description.LIGHT_TYPES` is also that of the type's files: SPOT stands in `spot.py`, as its `KIND`,
and in `spot.h`. In `types.h` they stand in the same order, and after them those with axes of their own.
"""

from __future__ import annotations

from importlib import import_module

from ..scene.description import LIGHT_TYPES, Light
from .kind import LightKind

KINDS: dict[str, LightKind] = {name: import_module(f".{name.lower()}", __package__).KIND for name in LIGHT_TYPES}
# As in `types.h`: SKEWED_SPOT is a spot that is scaled unevenly or sheared.
NAMES = [*KINDS, *(f"SKEWED_{name}" for name, kind in KINDS.items() if kind.skewed)]


def number(light: Light) -> int:
    """Return the row of `types.h` that says how much of the light arrives."""
    skewed = f"SKEWED_{light.type}"
    return NAMES.index(skewed if light.axes and skewed in NAMES else light.type)
