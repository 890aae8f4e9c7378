"""The same .blend in sharp mode has the same energy as in Cycles: direct light on diffuse surfaces, pixel by pixel."""

import math

import bpy
import numpy as np
import pytest

NEW = bpy.app.version >= (4, 5)

LIGHTS = {
    "point": ('POINT', {"energy": 300}),
    "coloured point": ('POINT', {"energy": 300, "color": (1, 0.3, 0.05)}),
    "scaled point": ('POINT', {"energy": 300, "scale": (3, 0.5, 2)}),
    "sun": ('SUN', {"energy": 3, "rotation": (0.5, 0.3, 0)}),
    "spot": ('SPOT', {"energy": 300, "rotation": (0.2, 0.1, 0), "spot_size": 1.2, "spot_blend": 0.5}),
    "hard spot": ('SPOT', {"energy": 300, "rotation": (0.2, 0.1, 0), "spot_size": 1.0, "spot_blend": 0.0}),
    "wide spot": ('SPOT', {"energy": 300, "spot_size": math.pi, "spot_blend": 1.0}),
    "scaled spot": ('SPOT', {"energy": 300, "spot_size": 1.0, "spot_blend": 0.3, "scale": (2, 2, 2)}),
    "narrowed spot": ('SPOT', {"energy": 300, "spot_size": 1.2, "spot_blend": 0.0, "scale": (1, 1, 2)}),
    "area": ('AREA', {"energy": 300, "size": 0.01, "rotation": (0.3, 0.2, 0)}),
    "oblong area": ('AREA', {"energy": 300, "shape": 'RECTANGLE', "size": 0.01, "size_y": 0.02}),
    "scaled disk": ('AREA', {"energy": 300, "shape": 'DISK', "size": 0.01, "scale": (2, 1, 1)}),
    "area of small spread": ('AREA', {"energy": 300, "size": 0.01, "spread": math.radians(60)}),
    "area of tiny spread": ('AREA', {"energy": 300, "size": 0.002, "spread": math.radians(40)}),
    "emission nodes": ('POINT', {"energy": 300, "nodes": ((0.2, 0.9, 0.4), 2.5)}),
}
if NEW:
    LIGHTS |= {
        "exposure": ('POINT', {"energy": 100, "exposure": 1.5}),
        "temperature": ('SUN', {"energy": 3, "use_temperature": True, "temperature": 3000, "color": (0.8, 1, 0.9)}),
        "unnormalized point": ('POINT', {"energy": 2000, "normalize": False, "shadow_soft_size": 0.05}),
        "unnormalized sun": ('SUN', {"energy": 3000, "normalize": False, "angle": math.radians(1)}),
        "unnormalized area": ('AREA', {
            "energy": 2e6, "normalize": False, "shape": 'ELLIPSE', "size": 0.01, "size_y": 0.02}),
    }


@pytest.mark.parametrize("name", LIGHTS)
def test_energy(scene, add_plane, add_light, add_mesh, diffuse, render, look_at, name):
    kind, properties = LIGHTS[name]
    properties = {"shadow_soft_size": 0.0} | ({"angle": 0.0} if kind == 'SUN' else {}) | properties
    nodes = properties.pop("nodes", None)
    light = add_light(kind, **properties).data
    if nodes:
        light.use_nodes = True
        emission = light.node_tree.nodes["Emission"]
        emission.inputs["Color"].default_value = (*nodes[0], 1)
        emission.inputs["Strength"].default_value = nodes[1]
    plane = add_plane(20)
    plane.data.materials.append(diffuse((0.8, 0.6, 0.4)))
    block = add_mesh("Block", [(x, y, z) for x in (-1, 0.5) for y in (1, 2) for z in (0.5, 1)],
                     [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    block.data.materials.append(diffuse((0.5, 0.5, 0.5), "Block"))
    narrow = kind == 'SPOT' or "spread" in properties
    scene.camera.location = (0.3, -3, 2.4) if narrow else (1, -9, 7)
    look_at(scene.camera, (0, 0, 0))
    scene.light_meshes.shadows = 'SHARP'
    scene.light_meshes.samples = 16
    ours = render(scene)["Combined"][..., :3]

    scene.render.engine = 'CYCLES'
    scene.cycles.samples = 64
    scene.cycles.max_bounces = 0
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.sample_clamp_direct = 0
    theirs = render(scene)["Combined"][..., :3]

    assert ours.shape == theirs.shape
    # Edge pixels are left out: each renderer has its own filter and its own samples.
    level = theirs.max(axis=2)
    padded = np.pad(level, 1, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
    inside = (around.max((2, 3)) < 1.35 * around.min((2, 3))) & (level > 1e-3 * level.max())
    assert inside.sum() > 100
    error = np.abs(ours - theirs)[inside].max(axis=1) / level[inside]
    assert np.median(error) < 0.005 and np.percentile(error, 99) < 0.02, (
        f"median {np.median(error):.4f}, 99 % {np.percentile(error, 99):.4f}, "
        f"ours / Cycles = {np.median(ours[inside] / theirs[inside]):.4f}")
    print(f"{name}: median {np.median(error):.5f}, 99 % {np.percentile(error, 99):.5f}, {inside.sum()} pixels")
