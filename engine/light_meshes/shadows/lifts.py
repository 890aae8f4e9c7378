"""How far receivers on smooth surfaces are lifted above their facets; for rays of kernels: `lifts.h`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Lift(NamedTuple):
    """Receivers on smooth surfaces that are made of facets, for shadow methods (see `terminator`)."""

    above: NDArray[np.float64]  # (n,3) world: the vector from P to the smooth surface
    side: NDArray[np.float64]  # (n,3) unit: the shading normal if P may be lifted, otherwise the geometric one
    cutoff: NDArray[np.float64]  # (n,) the cosine to a light below which P is lifted; 0: never
