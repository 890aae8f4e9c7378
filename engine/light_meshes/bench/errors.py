"""How far a picture is off, in linear float, and the references that it is held to (method §7).

RRTA: sharp shadows. HALF_BALL: the integral that light meshes converge to when h → 0 at the same r. SPHERE: lights
of a size, by many samples; for Cycles' noise the same light by Cycles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..picture.prepared import SHADED, Prepared
from ..picture.render import render_image
from ..rays.camera import camera_rays
from ..scene.description import Scene
from .scenes import radius

LOW, HIGH = 0.02, 0.98  # of S, in a penumbra
FINE = 6.0  # kI; nodes are hardly shared at that, and many
RAYS = 3e8  # about so many may be spent on a reference


def picture(scene: Scene) -> NDArray[np.float32]:
    """Linear RGB (height, width, 3), one ray through the middle of each pixel."""
    return render_image(scene.with_settings(samples=1)).passes["Combined"][..., :3]


def half_ball(scene: Scene) -> Scene:
    """Light meshes of the same r with so fine a lattice that a penumbra is off by .004 (0.14/kI²)."""
    return scene.with_settings(shadows="LIGHT_MESHES", h=radius(scene) / FINE, kI=FINE)


def sphere(scene: Scene) -> Scene:
    """Area sampling by as many samples as can be afforded."""
    receivers = scene.camera.width * scene.camera.height * len(scene.lights) / 2
    samples = 2 ** int(np.clip(np.log2(RAYS / receivers), 6, 12))
    return scene.with_settings(shadows="AREA_SAMPLING", light_samples=samples)


def penumbra(scene: Scene) -> NDArray[np.bool_]:
    """Pixels (height, width) in which some light is seen in part, 0.02 < S < 0.98, or focused; S as of `half_ball`."""
    ready = Prepared(half_ball(scene).with_settings(samples=1))
    camera = ready.scene.camera
    origin, direction, reach = camera_rays(camera, (0, 0, camera.width, camera.height), np.zeros((1, 2)))
    hit, seen = ready.closest("camera", origin, direction, None, reach)
    partly = np.zeros(len(seen.P), np.bool_)
    step = max(64, SHADED // max(1, len(scene.lights)))
    for i in range(0, len(seen.P), step):
        S = ready.light_visibility(seen.P[i:i + step], seen.Ng[i:i + step])
        S = S if S.ndim == 2 else S.mean(2)
        partly[i:i + step] = (((S > LOW) & (S < HIGH)) | (S > 2 - HIGH)).any(1)
    mask = np.zeros(len(hit), np.bool_)
    mask[hit] = partly
    return mask.reshape(camera.height, camera.width)


def compare(found: NDArray, reference: NDArray, partly: NDArray[np.bool_]) -> dict[str, Any]:
    """Errors over all pixels, and over those in and out of penumbrae."""
    difference = np.abs(found.astype(np.float64) - reference)
    return {"all": _norms(difference.reshape(-1)), "penumbra": _norms(difference[partly].reshape(-1)),
            "rest": _norms(difference[~partly].reshape(-1))}


def _norms(difference: NDArray[np.float64]) -> dict[str, float]:
    if not len(difference):
        return {"rmse": 0.0, "mae": 0.0, "p99": 0.0, "max": 0.0}
    return {"rmse": float(np.sqrt((difference**2).mean())), "mae": float(difference.mean()),
            "p99": float(np.quantile(difference, 0.99)), "max": float(difference.max())}
