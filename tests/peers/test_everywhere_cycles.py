"""Light from everywhere beside Cycles with as many bounces."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

pytestmark = pytest.mark.slow
WIDTH, HEIGHT = 120, 80


def box(add_mesh, material, centre, size, turn=0.0):
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    ob = add_mesh("box", corners, faces, location=centre, scale=size, rotation_euler=(0, 0, turn))
    ob.data.materials.append(material)


def matt(name, color):
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new('ShaderNodeBsdfDiffuse')
    shader.inputs["Color"].default_value = (*color, 1)
    tree.links.new(shader.outputs[0], tree.nodes.new('ShaderNodeOutputMaterial').inputs["Surface"])
    return material


def things(scene, add, add_mesh):
    """Boxes on a floor under a white sky."""
    world = scene.world = bpy.data.worlds.new("white")
    if bpy.app.version < (5, 0):
        world.use_nodes = False
    world.color = (1, 1, 1)
    if world.node_tree:
        world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    grey, red = matt("grey", (0.7, 0.7, 0.7)), matt("red", (0.6, 0.1, 0.1))
    box(add_mesh, grey, (0, 0, -0.05), (20, 20, 0.1))
    box(add_mesh, red, (-0.6, 0.2, 0.4), (0.8, 0.8, 0.8), 0.4)
    box(add_mesh, grey, (0.7, 0.1, 0.2), (1.0, 0.3, 0.4), -0.5)
    box(add_mesh, grey, (0.1, 0.3, 1.0), (2.4, 0.5, 0.04), 0.2)
    scene.camera.location, scene.camera.rotation_euler = (0, -4.2, 2.4), (1.05, 0, 0)


def room(scene, add, add_mesh):
    """A box room like Cornell's, under an area lamp."""
    white, red, green = matt("white", (0.75,) * 3), matt("red", (0.6, 0.08, 0.06)), matt("green", (0.1, 0.45, 0.12))
    for material, centre, size in ((white, (0, 0, -0.05), (2, 2, 0.1)), (white, (0, 0, 2.05), (2, 2, 0.1)),
                                   (white, (0, 1.05, 1), (2.2, 0.1, 2.2)), (red, (-1.05, 0, 1), (0.1, 2, 2.2)),
                                   (green, (1.05, 0, 1), (0.1, 2, 2.2))):
        box(add_mesh, material, centre, size)
    box(add_mesh, white, (-0.35, 0.3, 0.6), (0.6, 0.6, 1.2), 0.3)
    box(add_mesh, white, (0.4, -0.3, 0.3), (0.6, 0.6, 0.6), -0.3)
    lamp = bpy.data.lights.new("lamp", 'AREA')
    lamp.size, lamp.energy = 0.5, 40
    add(lamp, location=(0, 0, 1.98))
    scene.camera.location, scene.camera.rotation_euler = (0, -3.6, 1), (np.pi / 2, 0, 0)
    scene.camera.data.lens = 32


def blurred(picture):
    """The mean over 3 × 3 pixels, against Cycles' noise."""
    p = np.pad(picture[..., :3].mean(-1), 1, "edge")
    return sum(p[i:i + HEIGHT, j:j + WIDTH] for i in range(3) for j in range(3)) / 9


def as_cycles(scene, samples, bounces):
    """Let Cycles render the scene without its tricks."""
    cycles, scene.render.engine = scene.cycles, 'CYCLES'
    cycles.device, cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = 'CPU', samples, False, False
    cycles.max_bounces = cycles.diffuse_bounces = bounces
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.pixel_filter_type = 'BLACKMAN_HARRIS'


@pytest.mark.parametrize(("build", "bounces", "median", "most"), [(things, 0, 0.02, 0.08), (room, 1, 0.05, 0.15)])
def test_pictures_are_those_of_cycles(scene, add, add_mesh, render, build, bounces, median, most):
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    build(scene, add, add_mesh)
    own = scene.light_meshes
    own.world_light, own.bounces = 'SKY', bounces
    ours = blurred(render(scene)["Combined"])
    as_cycles(scene, 256, bounces)
    theirs = blurred(render(scene)["Combined"])
    error = np.abs(ours - theirs) / np.maximum(theirs, 0.01 * np.percentile(theirs, 99))
    assert np.median(error) < median
    assert np.percentile(error, 95) < most


def test_catchers_are_those_of_cycles(scene, add, add_mesh, render):
    """The alpha of a floor and a wall that catch shadows: of a box in the light of a sky and a sun, which light from
    the box brightens again. The wall's shadow on the floor does not count, and a glowing box gives light.
    """
    things(scene, add, add_mesh)
    floor, _, glowing, _ = (o for o in scene.objects if o.type == 'MESH')
    box(add_mesh, floor.data.materials[0], (0, 1.5, 1), (8, 0.1, 2))
    for catcher in (floor, scene.objects[-1]):
        catcher.is_shadow_catcher = True
    glow = bpy.data.materials.new("glow")
    if bpy.app.version < (5, 0):
        glow.use_nodes = True
    tree = glow.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new('ShaderNodeEmission')
    shader.inputs["Strength"].default_value = 3
    tree.links.new(shader.outputs[0], tree.nodes.new('ShaderNodeOutputMaterial').inputs["Surface"])
    glowing.data.materials[0] = glow
    lamp = bpy.data.lights.new("sun", 'SUN')
    lamp.energy, lamp.angle = 2, 0.02
    add(lamp, rotation_euler=(-0.8, 0.3, 0))
    scene.render.film_transparent = True
    scene.render.resolution_x, scene.render.resolution_y = 60, 40
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'SKY', 1
    ours = render(scene)["Combined"][..., 3]
    as_cycles(scene, 128, 1)
    theirs = render(scene)["Combined"][..., 3]
    caught = (np.maximum(ours, theirs) < 0.9) & (theirs > 0.05)  # not the things themselves
    assert 0.15 < caught.mean() < 0.7
    error = np.abs(ours - theirs)[caught]
    assert np.median(error) < 0.025 and np.percentile(error, 95) < 0.1, np.percentile(error, (50, 95))
    assert abs((ours - theirs)[caught].mean()) < 0.01
