"""What passes write of each object and material: the artist's numbers, mattes, and which objects are holes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Scene


class Numbers(NamedTuple):
    """Arrays with one row for each object, or for each material."""

    material_index: NDArray[np.float64]
    object_index: NDArray[np.float64]
    cryptomatte: dict[str, NDArray[np.uint32]]  # kind of Cryptomatte → of objects; CryptoMaterial: of materials
    holdout: NDArray[np.bool_]  # objects
    catcher: NDArray[np.bool_]


def numbers(scene: Scene) -> Numbers:
    """Return the numbers of a scene."""
    return Numbers(
        np.array([m.index for m in scene.materials], np.float64),
        np.array([o.index for o in scene.objects], np.float64),
        {"CryptoObject": np.array([o.cryptomatte for o in scene.objects], np.uint32),
         "CryptoAsset": np.array([o.cryptomatte_asset for o in scene.objects], np.uint32),
         "CryptoMaterial": np.array([m.cryptomatte for m in scene.materials], np.uint32)},
        np.array([o.holdout for o in scene.objects], np.bool_),
        np.array([o.shadow_catcher for o in scene.objects], np.bool_))
