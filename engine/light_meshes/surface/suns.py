"""What is small and bright in a world: suns, lamps of a studio. Each becomes a lamp, and is taken out of the table."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Light
from .sky_table import Radiance


def suns(finest: NDArray[np.float64], radiance: Radiance) -> list[tuple[Light, float]]:
    """The lamps for what is small and bright, each with its share of all light; `finest` loses their light."""
    return []
