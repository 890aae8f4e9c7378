"""Lamps with a size are seen as in Cycles: by cameras, in mirrors and through glass, where the artist lets them be."""

import math

import bpy
import numpy as np
import pytest
from node_pictures import both

pytestmark = pytest.mark.slow

LAMPS = {
    "POINT": {"shadow_soft_size": 0.3},
    "ball": {"shadow_soft_size": 0.3, "use_soft_falloff": False},
    "SPOT": {"shadow_soft_size": 0.3, "spot_size": math.radians(80), "spot_blend": 0.6},
    "SQUARE": {"size": 0.6},
    "ELLIPSE": {"size": 0.8, "size_y": 0.3},
    "spread": {"size": 0.6, "spread": math.radians(70)},
    "SUN": {"angle": 0.3},
}


def lamp(scene, kind):
    """A lamp that shines to the camera, which looks along −z from (0, 0, 3); a little aside and turned."""
    of = {"ball": 'POINT', "SQUARE": 'AREA', "ELLIPSE": 'AREA', "spread": 'AREA'}.get(kind, kind)
    data = bpy.data.lights.new(kind, of)
    data.energy = 0.05 if of == 'SUN' else 6.0  # less than what Cycles clamps indirect light to
    data.color = (1.0, 0.8, 0.5)
    if of == 'AREA':
        data.shape = 'ELLIPSE' if kind == "ELLIPSE" else 'SQUARE'
    for name, value in LAMPS[kind].items():
        if hasattr(data, name):
            setattr(data, name, value)
    ob = bpy.data.objects.new(kind, data)
    ob.location, ob.rotation_euler = (0.2, 0.1, 0.0), (math.pi - 0.2, 0.3, 0.0)
    scene.collection.objects.link(ob)
    return ob


@pytest.fixture
def view(scene):
    camera = scene.camera
    camera.location, camera.rotation_euler = (0, 0, 3), (0, 0, 0)
    camera.data.type, camera.data.angle = 'PERSP', 0.7
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.filter_size = 0.0
    scene.light_meshes.samples, scene.cycles.samples = 1, 4
    scene.cycles.filter_width, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = 0.01, False, False
    return scene


def alike(ours, theirs, kind, most=0.01):
    """The same silhouette, but for pixels at its edge, and the same radiance inside."""
    here, there = ours.max(2) > 0.01 * theirs.max(), theirs.max(2) > 0.01 * theirs.max()
    assert there.sum() > 20, kind
    assert (here ^ there).sum() <= 0.12 * there.sum(), (kind, here.sum(), there.sum())
    inside = here & there
    for axis in (0, 1):
        inside &= np.roll(here & there, 1, axis) & np.roll(here & there, -1, axis)
    error = np.abs(ours / np.maximum(theirs, 1e-9) - 1).max(2)[inside]
    assert np.median(error) <= most and np.quantile(error, 0.95) <= 3 * most, (kind, np.quantile(error, (0.5, 0.95)))


@pytest.mark.parametrize("kind", LAMPS)
def test_by_the_camera(view, render, kind):
    ob = lamp(view, kind)
    if kind == "SUN":
        ob.rotation_euler = (math.pi - 0.1, 0.05, 0)
    assert not both(view, render)[0].any()  # lamps are hidden from the camera unless the artist shows them
    ob.visible_camera = True
    alike(*both(view, render), kind)


@pytest.mark.parametrize("kind", ["POINT", "ELLIPSE", "SUN"])
def test_in_a_mirror(view, render, add_plane, node_material, kind):
    """The camera looks down on a mirror in which it sees the lamp above it."""
    mirror = add_plane(half=3.0)
    mirror.location = (0, 0, -0.5)
    mirror.data.materials.append(node_material("mirror", 'ShaderNodeBsdfAnisotropic' if not hasattr(
        bpy.types, "ShaderNodeBsdfGlossy") else 'ShaderNodeBsdfGlossy', Roughness=0.0))
    ob = lamp(view, kind)
    ob.location, ob.rotation_euler = (0.3, 0.2, 3.5), (0.1, 0.0, 0.0)
    alike(*both(view, render), kind, most=0.02)
    ob.visible_glossy = False
    assert not both(view, render)[0].any()


def test_through_glass(view, render, add_mesh, node_material):
    ob = lamp(view, "SQUARE")
    ob.visible_camera = True
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, 1.5))
    pane = bpy.context.object
    pane.scale = (4, 4, 0.1)
    pane.data.materials.append(node_material("glass", 'ShaderNodeBsdfGlass', Roughness=0.0, IOR=1.3))
    view.cycles.samples = 400  # it reflects or passes light by chance
    ours, theirs = both(view, render)
    alike(ours, theirs, "glass", most=0.03)
    ob.visible_transmission = False
    ours, theirs = both(view, render)
    assert ours.max() < 0.1 * theirs.max() or theirs.max() < 0.01


def test_a_rough_surface_shows_a_highlight_instead(view, render, add_plane, node_material):
    """Its few rays would show sharp images of the lamp, one beside the other."""
    floor = add_plane(half=3.0)
    floor.location = (0, 0, -0.5)
    floor.data.materials.append(node_material("rough", 'ShaderNodeBsdfGlossy', Roughness=0.5))
    ob = lamp(view, "ball")
    ob.location = (0.3, 0.2, 3.5)
    view.render.engine = 'LIGHT_MESHES'
    with_lamp = render(view)["Combined"][..., 0]
    ob.visible_glossy = True
    ob.data.shadow_soft_size = 1e-3  # too small to be met by a ray
    point = render(view)["Combined"][..., 0]
    assert with_lamp.max() <= 1.2 * point.max()
