"""Blender's transparent materials become kt, IOR and alpha; the settings of refraction reach the engine."""

from pathlib import Path

import bmesh
import bpy
import numpy as np
import pytest
from test_addon_materials import mixed


def test_glass(translated, node_material):
    glass = node_material("Glass", 'ShaderNodeBsdfGlass', Color=(0.9, 0.6, 0.3, 1), Roughness=0, IOR=1.5)
    found, scene = translated(glass)
    assert found.kt == pytest.approx((0.9, 0.6, 0.3)) and found.ior == pytest.approx(1.5)
    assert found.fresnel and found.kd == found.ka == 0 and found.alpha == 1 and not scene.warnings


def test_refraction_reflects_nothing(translated, node_material):
    found, _ = translated(node_material("Clear", 'ShaderNodeBsdfRefraction', Color=(1, 1, 1, 1), Roughness=0, IOR=1.33))
    assert found.kt == (1, 1, 1) and found.ior == pytest.approx(1.33) and not found.fresnel
    assert found.mirror == (0, 0, 0) and found.ks == 0


def test_rough_glass_is_clear_and_says_so(translated, node_material):
    found, scene = translated(node_material("Frosted", 'ShaderNodeBsdfGlass', Roughness=0.5))
    assert max(found.kt) > 0 and len(scene.warnings) == 1 and "'Frosted'" in scene.warnings[0]


def test_principled_transmission(translated, node_material):
    """The base colour is what two crossings leave, as in Cycles."""
    material = node_material("Bottle", 'ShaderNodeBsdfPrincipled', Base_Color=(0.25, 0.64, 0.81, 1), Roughness=0,
                             IOR=1.45, Transmission_Weight=1)
    found, scene = translated(material)
    assert found.kt == pytest.approx((0.5, 0.8, 0.9)) and found.ior == pytest.approx(1.45) and found.kd == 0
    assert found.fresnel and not scene.warnings
    material = node_material("Half", 'ShaderNodeBsdfPrincipled', Base_Color=(1, 1, 1, 1), Roughness=0, IOR=1.45,
                             Transmission_Weight=0.5)
    found, _ = translated(material)
    assert found.kt == pytest.approx((0.5,) * 3) and found.kd == pytest.approx(0.5) and found.ior == pytest.approx(1.45)


def test_transparent(translated, node_material):
    found, _ = translated(node_material("Nothing", 'ShaderNodeBsdfTransparent', Color=(1, 1, 1, 1)))
    assert found.alpha == 0
    found, _ = translated(node_material("Foil", 'ShaderNodeBsdfTransparent', Color=(0.9, 0.2, 0.1, 1)))
    assert found.alpha == 1 and found.kt == pytest.approx((0.9, 0.2, 0.1)) and found.ior == 1 and found.kd == 0


def test_mix_with_transparent(translated):
    material = mixed("Veil", 'ShaderNodeMixShader', ('ShaderNodeBsdfTransparent', {"Color": (1, 1, 1, 1)}),
                     ('ShaderNodeBsdfDiffuse', {"Color": (0.2, 0.4, 0.6, 1)}), 0.25)
    found, scene = translated(material)
    assert found.alpha == pytest.approx(0.25) and found.kd == pytest.approx(1) and not scene.warnings
    assert found.Od == pytest.approx((0.2, 0.4, 0.6))


def test_alpha(translated, node_material):
    found, scene = translated(node_material("Ghost", 'ShaderNodeBsdfPrincipled', Alpha=0.4))
    assert found.alpha == pytest.approx(0.4) and not scene.warnings


def leaf():
    image = bpy.data.images.new("leaf", 8, 8, alpha=True)
    pixels = np.ones((8, 8, 4), np.float32)
    pixels[:, :4, 3] = 0  # the left half is cut out
    pixels[..., :3] = (0.2, 0.7, 0.1)
    image.pixels.foreach_set(pixels.reshape(-1))
    image.pack()
    return image


@pytest.mark.parametrize("how", ["principled", "mix"])
def test_an_images_alpha_cuts_out(scene, add_plane, snapshot, render, how):
    material = bpy.data.materials.new("Leaf")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    texture, output = tree.nodes.new('ShaderNodeTexImage'), tree.nodes.new('ShaderNodeOutputMaterial')
    texture.image, texture.interpolation = leaf(), 'Closest'
    if how == "principled":
        shader = tree.nodes.new('ShaderNodeBsdfPrincipled')
        tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
        tree.links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])
    else:
        shader, surface = tree.nodes.new('ShaderNodeMixShader'), tree.nodes.new('ShaderNodeBsdfDiffuse')
        tree.links.new(texture.outputs["Color"], surface.inputs["Color"])
        tree.links.new(texture.outputs["Alpha"], shader.inputs[0])
        tree.links.new(tree.nodes.new('ShaderNodeBsdfTransparent').outputs[0], shader.inputs[1])
        tree.links.new(surface.outputs[0], shader.inputs[2])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    plane = add_plane(8)
    plane.data.uv_layers.new(name="UVMap")
    plane.data.materials.append(material)
    found = snapshot(scene)
    described = next(m for m in found.materials if m.name == "Leaf")
    assert described.alpha_image >= 0 and not found.warnings
    scene.render.film_transparent = True
    alpha = render(scene)["Combined"][..., 3]
    middle = alpha[alpha.shape[0] // 2]
    assert middle[2] == 0 and middle[-3] == pytest.approx(1)


def test_transparent_shadow_and_priority(translated, node_material):
    material = node_material("Wall", 'ShaderNodeBsdfGlass')
    material.use_transparent_shadow, material.light_meshes.priority = False, 3
    found, _ = translated(material)
    assert not found.transparent_shadow and found.priority == 3


def test_overrides(translated, node_material):
    material = node_material("Paper's", 'ShaderNodeBsdfDiffuse')
    own = material.light_meshes
    for name, value in {"kt": (0.7, 0.7, 0.7), "ior": 1.5, "fresnel": True, "alpha": 0.5}.items():
        setattr(own, f"override_{name}", True)
        setattr(own, name, value)
    found, _ = translated(material)
    assert found.kt == pytest.approx((0.7,) * 3) and found.ior == pytest.approx(1.5) and found.fresnel
    assert found.alpha == 0.5 and found.kd == 1


def test_settings_of_refraction_reach_the_engine(scene, add_plane, snapshot):
    add_plane()
    own = scene.light_meshes
    assert (own.refraction, own.glass, own.caustics, own.leak_free) == ('VIEW', 'BOUNDED', 'FOCUS', False)
    own.refraction, own.glass, own.caustics, own.leak_free = 'FULL', 'PAPER', 'PAPER', True
    found = snapshot(scene).settings
    assert (found.refraction, found.glass, found.caustics, found.leak_free) == ('FULL', 'PAPER', 'PAPER', True)


def test_light_that_bends_is_focused_unless_an_earlier_release_saved_the_file(addon, scene, snapshot, tmp_path):
    """full_of_0.1.blend was saved by release 0.1, whose default was Paper: it keeps it, and the panel shows it."""
    def caustics(scene):
        return walk.settings(scene, scene.view_layers[0])["caustics"]

    walk = addon.export.walk
    scene.light_meshes.refraction = 'FULL'
    assert caustics(scene) == scene.light_meshes.caustics == 'FOCUS'
    new, old = str(tmp_path / "new.blend"), str(Path(__file__).with_name("full_of_0.1.blend"))
    bpy.ops.wm.save_as_mainfile(filepath=new)
    bpy.ops.wm.open_mainfile(filepath=new)
    assert snapshot(bpy.context.scene).settings.caustics == bpy.context.scene.light_meshes.caustics == 'FOCUS'
    bpy.ops.wm.open_mainfile(filepath=old)
    saved = bpy.data.scenes["Scene"]
    assert caustics(bpy.context.evaluated_depsgraph_get().scene_eval) == 'PAPER'
    assert caustics(saved) == saved.light_meshes.caustics == 'PAPER'
    saved.light_meshes.refraction = 'VIEW'
    saved.light_meshes.refraction = 'FULL'
    assert caustics(saved) == 'PAPER'
    viewed = bpy.data.scenes["Viewed"].light_meshes  # light did not bend there: it is as in a new scene
    viewed.refraction = 'FULL'
    assert viewed.caustics == 'FOCUS'
    # Appended, not opened: nobody told the add-on that a file was read.
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(old) as (_, to):
        to.scenes = ["Scene"]
    assert caustics(to.scenes[0]) == 'PAPER'


BALLS = {"ball": (), "ball in a ball": (1.2,), "bubble": (1.0,)}


@pytest.mark.parametrize("case", ["slab", "panes", *BALLS])
def test_what_is_seen_through_glass_is_what_cycles_shows(scene, add, add_mesh, node_material, render, look_at, case):
    """Over glowing squares, pixel by pixel, but for those at edges. Inner bodies: Cycles has one relative index."""
    corners = [(i - 4, j - 4, 0) for j in range(9) for i in range(9)]
    floor = add_mesh("Floor", corners, [(k, k + 1, k + 10, k + 9) for k in range(71) if k % 9 < 8])
    for i, j in np.ndindex(8, 8):
        color = ((i + 1) / 8, (j + 1) / 8, (1 + (i + j) % 2) / 2, 1)
        floor.data.materials.append(node_material(f"Square {i} {j}", 'ShaderNodeEmission', Color=color, Strength=1))
        floor.data.polygons[8 * i + j].material_index = 8 * i + j
    world = bpy.data.worlds.new("World")
    world.color = (0.3, 0.3, 0.3)
    scene.world = world

    def body(index, within, smooth, radius=1.0, **place):
        mesh = bpy.data.meshes.new("Body")
        shape = bmesh.new()
        if smooth:
            bmesh.ops.create_uvsphere(shape, u_segments=96, v_segments=48, radius=radius)
        else:
            bmesh.ops.create_cube(shape, size=2)
        shape.to_mesh(mesh)
        mesh.polygons.foreach_set("use_smooth", [smooth] * len(mesh.polygons))
        glass = node_material("Glass", 'ShaderNodeBsdfRefraction', Color=(0.9, 0.95, 1, 1), Roughness=0,
                              IOR=index / within)
        glass.light_meshes.override_ior, glass.light_meshes.ior = True, index
        glass.light_meshes.priority = int(within != 1)
        mesh.materials.append(glass)
        add(mesh, **place)

    if case == "slab":
        body(1.5, 1.0, False, location=(0, 0, 1.5), scale=(1.5, 1.2, 0.4), rotation_euler=(0.3, 0.2, 0.1))
    elif case == "panes":
        for k in range(5):
            body(1.5, 1.0, False, location=(0, 0, 1 + 0.4 * k), scale=(1.5, 1.5, 0.1), rotation_euler=(0.1 * k, 0.2, 0))
    else:
        body(1.5, 1.0, True, location=(0, 0, 1.2))
        for index in BALLS[case]:
            body(index, 1.5, True, 0.5, location=(0.1, 0, 1.3))
    scene.camera.location = (2, -5, 6)
    look_at(scene.camera, (0, 0, 1))
    scene.camera.data.angle = 0.5
    scene.light_meshes.refraction, scene.light_meshes.samples, scene.light_meshes.max_depth = 'VIEW', 1, 0
    ours = render(scene)["Combined"][..., :3]
    scene.render.engine, cycles = 'CYCLES', scene.cycles
    cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = 1, False, False
    cycles.max_bounces = cycles.transmission_bounces = 32
    cycles.pixel_filter_type, cycles.filter_width = 'BOX', 0.01
    cycles.sample_clamp_indirect = 0
    theirs = render(scene)["Combined"][..., :3]
    differ = np.abs(ours - theirs).max(2) > 0.01
    print(f"{case}: {differ.mean():.2%} of the pixels differ")
    assert differ.mean() < 0.004
