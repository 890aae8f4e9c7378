"""Rough reflections beside Cycles: balls of metal, plastic and lacquer among things that glow, under a bright world."""

import bpy
import numpy as np
import pytest
from node_pictures import both
from node_trees import Tree

pytestmark = pytest.mark.slow

CELL, COLUMNS = 24, 4
PLASTIC = {"Base_Color": (0, 0, 0, 1)}
BALLS = [
    *(('ShaderNodeBsdfPrincipled', {"Base_Color": (0.9, 0.7, 0.4, 1), "Metallic": 1.0, "Roughness": r})
      for r in (0.1, 0.2, 0.3, 0.5, 0.7, 1.0)),
    ('ShaderNodeBsdfAnisotropic', {"Color": (0.8, 0.8, 0.8, 1), "Roughness": 0.4}),
    ('ShaderNodeBsdfPrincipled', PLASTIC | {"Roughness": 0.05}),
    ('ShaderNodeBsdfPrincipled', PLASTIC | {"Roughness": 0.2, "IOR": 2.5}),
    ('ShaderNodeBsdfPrincipled', PLASTIC | {"Roughness": 0.5, "Coat_Weight": 1.0, "Coat_Roughness": 0.05}),
]


@pytest.fixture
def balls(scene, add, node_material):
    """A ball of each kind, from above, in a row of glowing boxes; the world is bright."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=0.42)
    ball = bpy.context.object.data
    ball.polygons.foreach_set("use_smooth", [True] * len(ball.polygons))
    bpy.data.objects.remove(bpy.context.object)
    rows = -(-len(BALLS) // COLUMNS)
    for n, (kind, inputs) in enumerate(BALLS):
        mesh = ball.copy()
        mesh.materials.append(node_material(f"Ball {n}", kind, **inputs))
        x, y = 2 * (n % COLUMNS) - COLUMNS + 1, 2 * (n // COLUMNS) - rows + 1
        add(mesh, location=(x, y, 0))
    glows = [node_material(f"Glow {n}", 'ShaderNodeEmission', Color=(*color, 1)) for n, color in enumerate(
        ((0.9, 0.1, 0.1), (0.1, 0.7, 0.2), (0.1, 0.2, 0.9), (0.2, 0.2, 0.2)))]
    for x in range(-COLUMNS, COLUMNS + 1, 2):
        for y in range(-rows, rows + 1, 2):
            bpy.ops.mesh.primitive_cube_add(size=0.5, location=(x, y, 0.3))
            bpy.context.object.data.materials.append(glows[(x + y) // 2 % 3])
    bpy.ops.mesh.primitive_plane_add(size=40, location=(0, 0, -0.6))
    bpy.context.object.data.materials.append(glows[3])
    world = scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (0.5, 0.6, 0.8, 1)
    camera = scene.camera.data
    camera.type, camera.ortho_scale = 'ORTHO', 2 * max(COLUMNS, rows)
    scene.render.resolution_x, scene.render.resolution_y = 2 * CELL * COLUMNS, 2 * CELL * rows
    scene.render.filter_size, scene.light_meshes.samples = 0.0, 64
    scene.light_meshes.max_depth = 8
    c = scene.cycles
    c.samples, c.use_adaptive_sampling, c.use_denoising = 768, False, False
    c.max_bounces = c.glossy_bounces = 8
    c.pixel_filter_type, c.filter_width = 'BLACKMAN_HARRIS', 0.01
    c.sample_clamp_direct = c.sample_clamp_indirect = c.blur_glossy = 0
    return scene


def test_rough_balls_see_what_cycles_shows(balls, render):
    ours, theirs = both(balls, render)
    y, x = np.mgrid[:2 * CELL, :2 * CELL] - CELL + 0.5
    inside = np.hypot(x, y) < 0.38 * CELL
    for n, ball in enumerate(BALLS):
        row, column = -(-len(BALLS) // COLUMNS) - 1 - n // COLUMNS, n % COLUMNS
        cell = np.s_[2 * CELL * row:2 * CELL * (row + 1), 2 * CELL * column:2 * CELL * (column + 1)]
        a, b = ours[cell][inside], theirs[cell][inside]
        assert a.mean() == pytest.approx(b.mean(), rel=0.015), ball
        difference = np.abs(a - b).max(1) / b.max(1)
        assert np.quantile(difference, 0.99) <= 0.12, ball
        assert np.median(difference) <= 0.03, ball


@pytest.mark.parametrize(("clear", "other"), [("Glass", "Diffuse"), ("Glass", "Transparent"), ("Glass", "Principled"),
                                              ("Refraction", "Diffuse")])
def test_glass_mixed_with_another_shader(scene, render, add_plane, add_light, clear, other):
    """Without shadows: what passes glass in them is not what Cycles has."""
    ball(scene, add_plane, clear, other)
    add_light('SUN', rotation=(0.5, 0.3, 0), energy=2.0).data.use_shadow = False
    off = apart(*both(scene, render))
    assert np.median(off) <= 0.02 and np.quantile(off, 0.75) <= 0.05


def test_rough_mirrors_within_glass(scene, render, add_plane):
    """A rough mirror that is mixed with glass shows what the glass's other side mirrors, several times.

    Its many rays are faint; they were once left out, each for itself, and 3 % of all light with them.
    """
    ball(scene, add_plane, "Glass", "Anisotropic")
    scene.light_meshes.samples, scene.cycles.samples = 16, 1024
    ours, theirs = both(scene, render)
    off = apart(ours, theirs)
    assert np.median(off) <= 0.03 and np.quantile(off, 0.99) <= 0.12
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01)


def test_plastics_show_what_they_face(scene, render, add_plane, add_light, node_material):
    """A grey floor of rough plastic before a red wall and a blue one, which are lit: each part of it shimmers in the
    colour of what it faces. No ray is sent for it (`left` of surface/blurred.py). In half of the light of the plastic
    it was once grey, the mean of all that is around.
    """
    red, blue, plastic = (node_material(name, 'ShaderNodeBsdfPrincipled', Base_Color=(*color, 1), Roughness=rough)
                          for name, color, rough in (("Red", (0.8, 0.05, 0.05), 1.0), ("Blue", (0.05, 0.1, 0.8), 1.0),
                                                     ("Plastic", (0.1, 0.1, 0.1), 0.4)))
    for material, half, place, turn in ((plastic, 3.0, (0, 0, 0), (0, 0, 0)),
                                        (red, 2.0, (-2, 2, 2), (np.pi / 2, 0, np.pi / 4)),
                                        (blue, 2.0, (2, 2, 2), (np.pi / 2, 0, -np.pi / 4))):
        plane = add_plane(half=half, location=place)
        plane.rotation_euler = turn
        plane.data.materials.append(material)
    add_light('SUN', rotation=(1.1, 0, 0), energy=4.0)
    scene.camera.location, scene.camera.rotation_euler = (0, -3, 2.5), (0.75, 0, 0)
    scene.camera.data.angle = 0.7
    scene.render.engine = 'LIGHT_MESHES'
    scene.render.resolution_x, scene.render.resolution_y = 40, 30
    own, cycles = scene.light_meshes, scene.cycles
    own.world_light, own.bounces, own.samples = 'SKY', 1, 4
    cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = 512, False, False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 8, 1, 4
    cycles.sample_clamp_indirect = own.clamp_indirect = cycles.blur_glossy = 0
    ours = render(scene)["Combined"][..., :3]
    scene.render.engine = 'CYCLES'
    theirs = render(scene)["Combined"][..., :3]
    rows = np.s_[2:20, 2:-2]
    off = np.abs(ours[rows] - theirs[rows]).max(2) / theirs[rows].max(2)
    assert np.median(off) <= 0.025 and np.quantile(off, 0.95) <= 0.06
    left, right = theirs[rows][:, :12].mean((0, 1)), theirs[rows][:, -12:].mean((0, 1))
    assert left[0] > 1.3 * right[0] and right[2] > 1.3 * left[2]  # it is so in Cycles


def apart(ours, theirs):
    """How far the pictures differ at each pixel of the ball away from its rim, as a share of what Cycles has there."""
    assert theirs.max() > 0.2
    y, x = np.mgrid[:40, :40] - 19.5
    return (np.abs(ours - theirs).max(2) / np.maximum(theirs.max(2), 0.05))[np.hypot(x, y) < 13]


def ball(scene, add_plane, clear, other):
    """A ball of .6 glass and .4 of another shader before a glowing checker."""
    checks = Tree("Checks")
    pattern = checks.node('ShaderNodeTexChecker', {"Vector": checks.node('ShaderNodeTexCoord').outputs["Object"],
                                                   "Scale": 2.0, 1: (0.8, 0.3, 0.1, 1), 2: (0.1, 0.3, 0.7, 1)})
    glow = checks.node('ShaderNodeEmission', {"Color": pattern.outputs[0]})
    checks.tree.links.new(glow.outputs[0], checks.tree.nodes.new('ShaderNodeOutputMaterial').inputs[0])
    add_plane(half=4.0, location=(0, 0, -1.5)).data.materials.append(checks.material)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=1)
    tree, mesh = Tree("Mixed"), bpy.context.object.data
    for polygon in mesh.polygons:
        polygon.use_smooth = True
    glass = tree.node(f'ShaderNodeBsdf{clear}', {"Color": (0.9, 0.95, 1, 1), "Roughness": 0.0, "IOR": 1.3})
    mix = tree.tree.nodes.new('ShaderNodeMixShader')
    mix.inputs[0].default_value = 0.4
    tree.tree.links.new(glass.outputs[0], mix.inputs[1])
    tree.tree.links.new(tree.node(f'ShaderNodeBsdf{other}').outputs[0], mix.inputs[2])
    tree.tree.links.new(mix.outputs[0], tree.tree.nodes.new('ShaderNodeOutputMaterial').inputs[0])
    mesh.materials.append(tree.material)
    scene.camera.data.type, scene.camera.data.ortho_scale = 'ORTHO', 2.4
    scene.render.resolution_x = scene.render.resolution_y = 40
    scene.light_meshes.samples, cycles = 4, scene.cycles
    cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = 512, False, False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces, cycles.transmission_bounces = 8, 0, 4, 8
    cycles.sample_clamp_indirect = scene.light_meshes.clamp_indirect = 0
    cycles.blur_glossy = 0  # else Cycles takes glass for rough that rays of rough mirrors meet
