"""Lamps with a size light matt surfaces as in Cycles, from touching to far: the same .blend, nothing in the way."""

import math

import bpy
import numpy as np
import pytest

# Name → type, where it is, how it is turned, and its properties. The floor is z = 0, and 4 × 3 large.
LIGHTS = {
    "sphere, far": ('POINT', (0.3, 0.2, 6), (0, 0, 0), {"shadow_soft_size": 0.5, "use_soft_falloff": False}),
    "sphere, near": ('POINT', (0.3, 0.2, 0.8), (0, 0, 0), {"shadow_soft_size": 0.5, "use_soft_falloff": False}),
    "sphere, touching": ('POINT', (0.3, 0.2, 0.501), (0, 0, 0), {"shadow_soft_size": 0.5, "use_soft_falloff": False}),
    "sphere, half sunk": ('POINT', (0.3, 0.2, 0.1), (0, 0, 0), {"shadow_soft_size": 0.5, "use_soft_falloff": False}),
    "sphere, mostly sunk": ('POINT', (0.3, 0.2, -0.3), (0, 0, 0), {"shadow_soft_size": 0.5, "use_soft_falloff": False}),
    "disc to the eye, near": ('POINT', (0.3, 0.2, 0.4), (0, 0, 0), {"shadow_soft_size": 0.5}),
    "disc to the eye, half sunk": ('POINT', (0.3, 0.2, 0.05), (0, 0, 0), {"shadow_soft_size": 0.5}),
    "sun": ('SUN', (0, 0, 5), (0.5, 0.3, 0), {"angle": math.radians(20)}),
    "sun, half down": ('SUN', (0, 0, 5), (math.radians(88), 0, 0.4), {"angle": math.radians(30)}),
    "spot": ('SPOT', (0.3, 0.2, 2), (0.2, 0.1, 0), {"shadow_soft_size": 0.3, "spot_size": 0.8, "spot_blend": 0.3,
                                                    "use_soft_falloff": False}),
    "spot, hard": ('SPOT', (0.3, 0.2, 1.5), (0.2, 0.1, 0),
        {"shadow_soft_size": 0.4, "spot_size": 0.9, "spot_blend": 0.0,
                                                          "use_soft_falloff": False}),
    "spot, disc to the eye": ('SPOT', (0.3, 0.2, 1.5), (0.2, 0.4, 0), {"shadow_soft_size": 0.4, "spot_size": 1.2,
                                                                      "spot_blend": 1.0}),
    "spot, near": ('SPOT', (0.3, 0.2, 0.6), (0.2, 0.1, 0),
        {"shadow_soft_size": 0.5, "spot_size": 2.0, "spot_blend": 0.5,
                                                           "use_soft_falloff": False}),
    "spot, narrowed": ('SPOT', (0.3, 0.2, 2), (0.2, 0.1, 0), {"shadow_soft_size": 0.3, "spot_size": 1.2,
                                                             "spot_blend": 0.4, "scale": (1, 1, 2),
                                                             "use_soft_falloff": False}),
    "square, far": ('AREA', (0.3, 0.2, 5), (0.2, 0.1, 0), {"size": 1.0}),
    "square, near": ('AREA', (0.3, 0.2, 0.5), (0, 0, 0.3), {"size": 2.0}),
    # At .01 Cycles is 3 % off beside the lamp, against a sum over its parts too, which we meet within 1e-5.
    "square, touching": ('AREA', (0.3, 0.2, 0.03), (0, 0, 0.3), {"size": 1.0}),
    "rectangle, oblique": ('AREA', (0.3, 0.2, 0.7), (1.0, 0.4, 0.3),
        {"shape": 'RECTANGLE', "size": 1.0, "size_y": 0.3}),
    "rectangle, sunk": ('AREA', (0.3, 0.2, 0.2), (1.2, 0.0, 0.3), {"shape": 'RECTANGLE', "size": 1.0, "size_y": 1.0}),
    "disc, near": ('AREA', (0.3, 0.2, 0.3), (0.3, 0.1, 0), {"shape": 'DISK', "size": 1.0}),
    "disc, sunk": ('AREA', (0.3, 0.2, 0.1), (1.2, 0.1, 0), {"shape": 'DISK', "size": 1.0}),
    "ellipse, oblique": ('AREA', (0.3, 0.2, 0.7), (1.0, 0.4, 0.3), {"shape": 'ELLIPSE', "size": 1.4, "size_y": 0.3}),
    "ellipse, scaled": ('AREA', (0.3, 0.2, 0.6), (0.3, 0.4, 0.3), {"shape": 'DISK', "size": 0.5, "scale": (2, 1, 1)}),
    "square, spread 90": ('AREA', (0.3, 0.2, 0.5), (0.1, 0, 0.3), {"size": 1.0, "spread": math.radians(90)}),
    "square, spread 15": ('AREA', (0.3, 0.2, 2.0), (0.1, 0, 0.3), {"size": 2.0, "spread": math.radians(15)}),
    "disc, spread 60": ('AREA', (0.3, 0.2, 0.8), (0.3, 0, 0.3), {"shape": 'DISK', "size": 1.0,
                                                              "spread": math.radians(60)}),
    "rectangle, sunk, spread 120": ('AREA', (0.3, 0.2, 0.2), (1.2, 0.0, 0.3), {
        "shape": 'RECTANGLE', "size": 1.0, "size_y": 1.0, "spread": math.radians(120)}),
}


# Those that Cycles is slow to agree with itself about: dim edges. They have a quarter of the pixels.
NOISY = {"spot, hard", "disc, sunk"}


def through_the_middle(scene, samples):
    """Both engines: one ray through the middle of a pixel, direct light only, no denoiser."""
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = 'CPU', samples, False, False
    cycles.pixel_filter_type, cycles.filter_width, cycles.max_bounces = 'BLACKMAN_HARRIS', 0.01, 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    scene.light_meshes.mode, scene.light_meshes.samples, scene.light_meshes.bounces = 'LOCAL', 1, 0
    scene.render.resolution_x, scene.render.resolution_y = 32, 24


def differences(name, scene, add_plane, add_light, diffuse, render):
    """|ours − Cycles'| / Cycles' of all pixels that are not dark."""
    kind, location, rotation, properties = LIGHTS[name]
    lamp = add_light(kind, location=location, rotation=rotation, energy=3 if kind == 'SUN' else 300, **properties)
    lamp.visible_camera = False
    lamp.data.light_meshes.softness = 'SIZE'
    add_plane(20).data.materials.append(diffuse((0.8, 0.6, 0.4)))
    through_the_middle(scene, 16384 if name in NOISY else 1024)
    scene.render.resolution_percentage = 50 if name in NOISY else 100
    scene.camera.data.type, scene.camera.data.ortho_scale = 'ORTHO', 4
    ours = render(scene)["Combined"][..., :3]
    scene.render.engine = 'CYCLES'
    theirs = render(scene)["Combined"][..., :3]
    level = theirs.max(axis=2)
    lit = level > 0.01 * level.max()
    assert lit.mean() > 0.05
    return (np.abs(ours - theirs).max(axis=2) / np.maximum(level, 1e-12))[lit]


@pytest.mark.slow
@pytest.mark.parametrize("name", LIGHTS)
def test_whole_lamps_give_cycles_light(scene, add_plane, add_light, diffuse, render, name):
    properties = LIGHTS[name][3]
    if "use_soft_falloff" in properties and "use_soft_falloff" not in bpy.types.PointLight.bl_rna.properties:
        pytest.skip("this Blender's lamps are always discs that turn to each receiver")
    error = differences(name, scene, add_plane, add_light, diffuse, render)
    print(f"{name}: median {np.median(error):.5f}, 99 % {np.quantile(error, 0.99):.5f}, {len(error)} pixels")
    assert np.median(error) <= 0.005 and np.quantile(error, 0.99) <= 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("name", "roughness"), [
    ("sphere, near", 0.2), ("sphere, near", 0.5), ("sun", 0.2), ("square, near", 0.2), ("square, near", 0.5),
    ("rectangle, oblique", 0.2), ("disc, near", 0.5), ("ellipse, oblique", 0.2), ("ellipse, oblique", 0.5),
    ("disc, spread 60", 0.2)])
def test_whole_lamps_give_cycles_highlights(scene, add_plane, add_light, render, name, roughness):
    """Microfacets of a metal: within 5 % where it is brighter than a twentieth of the brightest."""
    kind, location, rotation, properties = LIGHTS[name]
    properties = {k: v for k, v in properties.items()
                  if k != "use_soft_falloff" or k in bpy.types.PointLight.bl_rna.properties}
    lamp = add_light(kind, location=location, rotation=rotation, energy=3 if kind == 'SUN' else 300, **properties)
    lamp.visible_camera = False
    lamp.data.light_meshes.softness = 'SIZE'
    metal = bpy.data.materials.new("Metal")
    metal.use_nodes = True
    principled = metal.node_tree.nodes["Principled BSDF"]
    for key, value in (("Base Color", (0.9, 0.7, 0.5, 1)), ("Metallic", 1.0), ("Roughness", roughness)):
        principled.inputs[key].default_value = value
    add_plane(20).data.materials.append(metal)
    through_the_middle(scene, 512)
    scene.camera.location, scene.camera.rotation_euler, scene.camera.data.lens = (0, -3.5, 2.5), (0.95, 0, 0), 35
    ours = render(scene)["Combined"][..., :3]
    scene.render.engine = 'CYCLES'
    theirs = render(scene)["Combined"][..., :3]
    level = theirs.max(axis=2)
    shines = level > 0.05 * level.max()
    error = (np.abs(ours - theirs).max(axis=2) / np.maximum(level, 1e-12))[shines]
    print(f"{name}, {roughness}: median {np.median(error):.4f}, 95 % {np.quantile(error, 0.95):.4f}, {len(error)}")
    assert len(error) > 15
    assert np.median(error) <= 0.02 and np.quantile(error, 0.95) <= 0.05
