"""Compute the error of a picture in linear light, and the references to compare it with (method §7).

RRTA: sharp shadows. HALF_BALL: the integral to which light meshes converge when h → 0 with the same r. SPHERE: lights
with a size, by many samples. The noise of Cycles is measured against a picture by Cycles of the same lights.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..picture.lighting import SHADED
from ..picture.prepared import Prepared
from ..picture.render import render_image
from ..rays.camera import camera_rays
from ..scene.description import Scene
from . import judge
from .scenes import radius

LOW, HIGH = 0.02, 0.98  # range of S in a penumbra
FINE = 6.0  # the kI for references; with it nodes are many and hardly shared
RAYS = 3e8  # the number of rays that a reference may use, about


def picture(scene: Scene) -> NDArray[np.float32]:
    """Return linear RGB, shape (height, width, 3), with one ray through the centre of each pixel."""
    return render_image(scene.with_settings(samples=1)).passes["Combined"][..., :3]


def half_ball(scene: Scene) -> Scene:
    """Return the scene with light meshes of the same r on a lattice so fine that a penumbra has an error of .004
    (0.14/kI²).
    """
    return scene.with_settings(shadows="LIGHT_MESHES", h=radius(scene) / FINE, kI=FINE)


def sphere(scene: Scene) -> Scene:
    """Return the scene with area sampling, with as many samples as the time allows."""
    receivers = scene.camera.width * scene.camera.height * len(scene.lights) / 2
    samples = 2 ** int(np.clip(np.log2(RAYS / receivers), 6, 12))
    return scene.with_settings(shadows="AREA_SAMPLING", light_samples=samples)


def penumbra(scene: Scene) -> NDArray[np.bool_]:
    """Return the pixels, shape (height, width), in which some light is partly visible, 0.02 < S < 0.98, or focused. S
    is that of `half_ball`.
    """
    ready = Prepared(half_ball(scene).with_settings(samples=1))
    camera = ready.scene.camera
    origin, direction, reach = camera_rays(camera, (0, 0, camera.width, camera.height), np.zeros((1, 2)))
    hit, seen = ready.world.closest("camera", origin, direction, None, reach)
    partly = np.zeros(len(seen.P), np.bool_)
    step = max(64, SHADED // max(1, len(scene.lights)))
    for i in range(0, len(seen.P), step):
        S = ready.lighting.light_visibility(seen.P[i:i + step], seen.Ng[i:i + step]).mean(2)
        partly[i:i + step] = (((S > LOW) & (S < HIGH)) | (S > 2 - HIGH)).any(1)
    mask = np.zeros(len(hit), np.bool_)
    mask[hit] = partly
    return mask.reshape(camera.height, camera.width)


def compare(found: NDArray, reference: NDArray, partly: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the errors over all pixels, and over the pixels inside and outside of penumbrae; with HDR-FLIP, if
    flip-evaluator is installed.
    """
    difference = np.abs(found.astype(np.float64) - reference)
    result = {"all": _norms(difference.reshape(-1)), "penumbra": _norms(difference[partly].reshape(-1)),
              "rest": _norms(difference[~partly].reshape(-1))}
    if judge.available():  # HDR-FLIP, as an observer sees it
        seen = judge.flip(np.asarray(reference, np.float32), np.asarray(found, np.float32))
        for name, of in (("all", np.ones_like(partly)), ("penumbra", partly), ("rest", ~partly)):
            result[name]["flip"] = float(seen[of].mean()) if of.any() else 0.0
    return result


def _norms(difference: NDArray[np.float64]) -> dict[str, float]:
    if not len(difference):
        return {"rmse": 0.0, "mae": 0.0, "p99": 0.0, "max": 0.0}
    return {"rmse": float(np.sqrt((difference**2).mean())), "mae": float(difference.mean()),
            "p99": float(np.quantile(difference, 0.99)), "max": float(difference.max())}
