"""Whole matt pictures under lamps with a size against Cycles, at a new scene's defaults: at most 1.1 times as far off
as area sampling with 16 rays.

Each scene of `sized_lamps` under one lamp here; `LIGHT_MESHES_ALL_PICTURES=1 pytest -s` of this file tries all lamps.
"""

import math
import os

import bpy
import numpy as np
import pytest
from sized_lamps import LAMPS, SCENES

NAMES = [*LAMPS]
SOME = [(name, NAMES[n % len(NAMES)]) for n, name in enumerate(SCENES)]
ALL = [(name, lamp) for name in SCENES for lamp in NAMES]
SIZE, SAMPLES = 64, 400


def rotation(lamp):
    """Blender's: a lamp shines along −z, and area lamps here are sized along x and y."""
    x, y, z = lamp.direction
    return (0.0, math.acos(min(1.0, max(-1.0, -z))), math.atan2(y, x) + math.pi)


def lit(name, lamp, add_mesh, add_light, diffuse):
    """Put a scene of `sized_lamps` and its lamp into Blender."""
    white = diffuse((0.7, 0.7, 0.7))
    for shape in SCENES[name]():
        for matrix in shape.matrices:
            corners = shape.mesh.vertices @ np.asarray(matrix)[:3, :3].T + np.asarray(matrix)[:3, 3]
            ob = add_mesh(shape.name, corners.tolist(), shape.mesh.triangles.tolist())
            ob.data.materials.append(white)
    one = LAMPS[lamp]
    properties = {"POINT": {"shadow_soft_size": one.radius}, "SPOT": {"shadow_soft_size": one.radius,
                  "spot_size": one.spot_angle, "spot_blend": 0.1}, "SUN": {"angle": one.angle}}.get(one.type)
    if properties is None:
        width, height = (2 * float(np.abs(side).max()) for side in (one.area_u, one.area_v))
        properties = {"shape": 'ELLIPSE' if one.area_ellipse else 'RECTANGLE', "size": width, "size_y": height}
    place = one.position if one.type != "SUN" else (0, 0, 4)
    turn = (0, 0, 0) if one.type in ("POINT", "AREA") else rotation(one)
    made = add_light(one.type, place, turn, energy=3 if one.type == "SUN" else 300, **properties)
    made.visible_camera = False
    made.data.light_meshes.softness = 'SIZE'


@pytest.mark.slow
@pytest.mark.parametrize(("name", "lamp"), ALL if os.environ.get("LIGHT_MESHES_ALL_PICTURES") else SOME)
def test_whole_pictures_are_as_near_to_cycles_as_area_sampling(scene, add_mesh, add_light, diffuse, render, name, lamp):
    lit(name, lamp, add_mesh, add_light, diffuse)
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.camera.data.type, scene.camera.data.ortho_scale = 'ORTHO', 2
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = 'CPU', SAMPLES, False, False
    cycles.pixel_filter_type, cycles.filter_width, cycles.max_bounces = 'BLACKMAN_HARRIS', 1.5, 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    ours = render(scene)["Combined"][..., :3]
    scene.light_meshes.shadows, scene.light_meshes.light_samples = 'AREA_SAMPLING', 16
    rival = render(scene)["Combined"][..., :3]
    scene.render.engine = 'CYCLES'
    theirs = render(scene)["Combined"][..., :3]
    off, other = (float(np.sqrt(np.mean((a - theirs) ** 2)) / theirs.mean()) for a in (ours, rival))
    print(f"{name}, {lamp}: {off:.4f} of the mean, area sampling with 16 rays {other:.4f}: {off / other:.2f}")
    assert bpy.app.version >= (4, 2) and theirs.mean() > 0.01
    assert off <= 1.1 * other
