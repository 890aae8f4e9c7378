"""What receivers see of the lights, as the tests ask for it."""

from __future__ import annotations

import numpy as np
from light_meshes.picture.prepared import Prepared
from numpy.typing import NDArray


def visibility(ready: Prepared, P: NDArray, N: NDArray, triangle: NDArray | None = None) -> NDArray[np.float32]:
    """Return S (n,L) of all lights in front of receivers P with unit normals N; (n,L,3) where there is coloured glass.
    """
    S = ready.lighting.light_visibility(P, N, triangle)
    return S[..., 0] if S.shape[2] == 1 else S
