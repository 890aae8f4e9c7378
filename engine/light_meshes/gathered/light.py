"""The light that the rays of records find."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .patches import Patches
from .rays import Check, Seen, joined


class Light(NamedTuple):
    """The radiance that rays find, as the kernel `records_sum` takes it: for matt surfaces, and for glossy ones, which
    show it with one bounce more.
    """

    distance: NDArray[np.float32]  # (r,d) to the first surface that is there; 0: none
    number: NDArray[np.int32]  # (r,d) of a patch; −1: the sky; from −2 down: 0 on of `extra`
    patch: NDArray[np.float64]  # (m,3)
    extra: NDArray[np.float64]  # (e,3)
    glossy: NDArray[np.float64] | None  # (m,3); None: the same
    glossy_extra: NDArray[np.float64] | None  # (e,3)
    sky: NDArray[np.float64]  # (3,)


def light_of(seen: Seen, each: int, patches: Patches, bounces: int, glossy: bool, check: Check) -> Light:
    """Return the light of the sky and of patches that rays find, `each` of them from the same point. glossy: for glossy
    surfaces, too, unless there are no bounces at all.
    """
    layers, behind, more = seen.layers, list[NDArray[np.int32]](), None
    if bounces == 0 and patches.dark:  # all that they meet is black
        number, patch, layers = np.where(seen.distance > 0, np.int32(0), np.int32(-1)), np.zeros((1, 3)), []
    else:
        with patches.asked():
            number = patches.met(joined([seen.met, *(layer.met for layer in layers)]), check)
            patch = patches.radiance(number, bounces, check)
            if glossy and bounces > 0:
                more = patches.radiance(number, bounces + 1, check)
        number, *behind = np.split(number, np.cumsum([len(seen.distance), *(len(layer.row) for layer in layers)])[:-1])

    def extra(of: NDArray[np.float64]) -> NDArray[np.float64]:
        light = seen.light.copy()
        for layer, met in zip(layers, behind, strict=True):
            light[layer.row] += layer.weight * of[met]
        return light

    number[seen.row] = -2 - np.arange(len(seen.row))
    return Light(seen.distance.reshape(-1, each), number.reshape(-1, each), patch, extra(patch), more,
                 None if more is None else extra(more), seen.sky)


def together(first: Light, rows: NDArray[np.int64], more: Light) -> Light:
    """Return what is found by these rows (m,) of the first rays and by more rays from the same points (m,)."""
    number = np.where(more.number < -1, more.number - len(first.extra), more.number)

    def both(a: NDArray | None, b: NDArray | None) -> NDArray | None:
        return None if a is None or b is None else np.concatenate([a, b])

    return more._replace(distance=np.concatenate([first.distance[rows], more.distance], 1),
                         number=np.concatenate([first.number[rows], number], 1),
                         extra=np.concatenate([first.extra, more.extra]),
                         glossy_extra=both(first.glossy_extra, more.glossy_extra))
