"""Passes in Blender: their names, the properties that switch them on, and the contents of the file that Blender
writes.
"""

import bpy
import light_meshes.film.passes
import numpy as np
import pytest

STANDARD = ("use_pass_z", "use_pass_position", "use_pass_normal", "use_pass_uv", "use_pass_object_index",
            "use_pass_material_index", "use_pass_diffuse_direct", "use_pass_glossy_direct",
            "use_pass_transmission_direct", "use_pass_emit", "use_pass_environment", "use_pass_mist")
MATTES = ("use_pass_cryptomatte_object", "use_pass_cryptomatte_material", "use_pass_cryptomatte_asset")


@pytest.fixture
def passes(addon):
    from light_meshes_addon import passes

    return passes


def everything(scene, passes):
    layer = scene.view_layers[0]
    for p in passes.ALL.values():
        setattr(p.owner(layer), p.switch, True)


def blenders(name, passes):
    return passes.ALL[name].name


def test_the_lists_of_add_on_and_engine_agree(passes):
    assert {p.engine_name: p.channel_ids for p in passes.ALL.values()} == light_meshes.film.passes.PASSES
    assert sorted(passes.DATA + passes.LIGHT + passes.DEBUG) == sorted(passes.ALL)
    assert len({p.name for p in passes.ALL.values()}) == len(passes.ALL)


def test_standard_passes_are_those_of_cycles(scene, passes):
    """Name, channels and kind, whatever this Blender calls them: a compositor made for Cycles finds them."""
    from cycles.engine import list_render_passes

    layer = scene.view_layers[0]
    for name in STANDARD + MATTES:
        setattr(layer, name, True)
    scene.cycles.use_denoising = False
    for depth, levels in ((2, 1), (5, 3), (6, 3), (16, 8)):
        layer.pass_cryptomatte_depth = depth
        theirs = set(list_render_passes(scene, layer))
        ours = {(p.name, p.channel_ids, p.kind) for p in passes.wanted(scene, layer)}
        assert ours == theirs and len(ours) == 1 + len(STANDARD) + levels * len(MATTES)


@pytest.fixture
def still_life(scene, add_plane, add_light, node_material, diffuse):
    """A lit plane, half of it under a pane of glass, a mirror and a lamp's glow beside it."""
    floor = add_plane(3, name="Floor", pass_index=7)
    floor.data.materials.append(diffuse((0.5, 0.4, 0.3)))
    floor.data.materials[0].pass_index = 11
    floor.data.uv_layers.new(name="UV")
    glass = node_material("Pane", 'ShaderNodeBsdfTransparent', Color=(0.5, 0.5, 1, 1))
    add_plane(0.8, name="Pane", location=(-1.5, 0, 0.5)).data.materials.append(glass)
    mirror = node_material("Mirror", 'ShaderNodeBsdfGlossy', Color=(0.9, 0.9, 0.9, 1), Roughness=0)
    add_plane(0.8, name="Mirror", location=(1.5, 0, 0.5)).data.materials.append(mirror)
    glow = node_material("Glow", 'ShaderNodeEmission', Color=(1, 0.5, 0.2, 1), Strength=2)
    add_plane(0.5, name="Glow", location=(0, 1.5, 0.5)).data.materials.append(glow)
    add_light('SUN', energy=3, angle=0, rotation=(0.2, 0.1, 0)).name = "Sun"
    add_light('POINT', energy=100, location=(0.5, -0.5, 2)).name = "Point"
    scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.1, 0.2, 0.3, 1)
    scene.light_meshes.auto_h, scene.light_meshes.h = False, 0.1
    return scene


def test_all_passes_arrive_with_their_channels_and_add_up(still_life, passes, render):
    everything(still_life, passes)
    for light in bpy.data.lights:
        light.light_meshes.shadow_pass = True
    found = render(still_life)
    expected = {p.name: p.channels for p in passes.ALL.values()} | {"Shadow Sun": 3, "Shadow Point": 3}
    assert {name: pixels.shape[2] for name, pixels in found.items()} == expected
    parts = [found[blenders(name, passes)] for name in passes.LIGHT if name not in ("Shadow", "Ambient Occlusion")]
    np.testing.assert_allclose(sum(parts), found["Combined"][..., :3], rtol=0, atol=1e-6)
    gathered = ("Diffuse Indirect", "Ambient Occlusion")  # nothing is, here
    assert all((found[blenders(n, passes)].max() > 0.01) != (n in gathered) for n in passes.LIGHT)
    y, x = 24, 32  # the floor
    assert found[blenders("Object Index", passes)][y, x, 0] == 7
    assert found[blenders("Material Index", passes)][y, x, 0] == 11
    u = found["UV"][y, x]
    assert u[:2] == pytest.approx((0.5, 0.5), abs=0.02) and u[2] == 1
    assert found["Position"][y, x] == pytest.approx((0, 0, 0), abs=0.15)
    assert found["Debug Candidates"][y, x, 0] > 20
    np.testing.assert_allclose((found["Shadow Sun"] + found["Shadow Point"]) / 2, found["Shadow"], atol=1e-6)
    assert 0 < (found["Shadow Sun"][..., 0] < 0.5).sum() < found["Shadow Sun"][..., 0].size


def test_the_uv_pass_needs_no_image(scene, add_plane, render, capfd):
    plane, bare = add_plane(4), add_plane(0.5, name="Bare", location=(0, 0, 1))
    plane.data.uv_layers.new(name="UV")
    scene.view_layers[0].use_pass_uv = True
    uv = render(scene)["UV"]
    assert uv[20, 10, :2].tolist() != [0, 0] and uv[24, 32].tolist() == [0, 0, 1] and bare
    assert "UV map" not in capfd.readouterr().out


def test_nothing_is_asked_for_that_nobody_wants(scene, add_plane, snapshot, passes):
    plane = add_plane()
    plane.data.uv_layers.new(name="UV")
    assert [p.name for p in passes.wanted(scene, scene.view_layers[0])] == ["Combined"]
    assert len(snapshot(scene).geometry.uvs) == 0


def render_layers(scene):
    if bpy.app.version >= (5, 0):
        tree = scene.compositing_node_group = bpy.data.node_groups.new("Compositing", 'CompositorNodeTree')
    else:
        scene.use_nodes = True
        tree = scene.node_tree
    return tree.nodes.new('CompositorNodeRLayers')


def test_every_switch_shows_its_pass_in_the_compositor(scene, add_light, passes):
    """At once: who connects nodes should not have to render first."""
    node, layer = render_layers(scene), scene.view_layers[0]
    light = add_light().data
    light.name = "Key"

    def sockets():
        return {s.name for s in node.outputs if s.enabled}

    before = sockets()
    switches = [(p.owner(layer), p.switch, p.name) for p in passes.ALL.values() if p.engine_name != "Combined"]
    for owner, switch, name in [*switches, (light.light_meshes, "shadow_pass", "Shadow Key")]:
        setattr(owner, switch, True)
        assert sockets() - before == {name}, switch
        setattr(owner, switch, False)
        assert sockets() == before, switch


def test_a_switch_counts_from_the_next_render_on(scene, add_plane, add_light, render):
    """Also where it is an add-on's property, which evaluated data would not have by itself."""
    add_plane(5)
    light = add_light('SUN', energy=1, angle=0)
    light.data.name = "Sun"
    scene.world = bpy.data.worlds.new("World")
    scene.world.color = (0.5, 0.5, 0.5)
    assert set(render(scene)) == {"Combined"}
    scene.view_layers[0].light_meshes.use_pass_ambient = light.data.light_meshes.shadow_pass = True
    found = render(scene)
    assert set(found) == {"Combined", "Ambient", "Shadow Sun"}
    assert (found["Shadow Sun"][24, 32] == 1).all() and found["Ambient"][24, 32, 0] > 0.01
    scene.view_layers[0].light_meshes.use_pass_ambient = light.data.light_meshes.shadow_pass = False
    assert set(render(scene)) == {"Combined"}


def test_switches_survive_save_and_load(scene, add_light, tmp_path):
    scene.view_layers[0].light_meshes.use_pass_ambient = True
    add_light().data.light_meshes.shadow_pass = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    scene = bpy.context.scene
    assert scene.view_layers[0].light_meshes.use_pass_ambient and bpy.data.lights[0].light_meshes.shadow_pass


# One shadow pass a light

def test_lights_of_any_name_have_a_pass_of_their_own(scene, add_plane, add_light, render, passes):
    """Dots, slashes, names that differ in a dot only, and one longer than a pass's name may be."""
    add_plane(5)
    names = ["Key.001", "Key_001", "../Rim", "Füll", "x" * 60]
    for n, name in enumerate(names):
        light = add_light('SUN', energy=1, angle=0, rotation=(0, 0.3 * n, 0))
        light.name, light.data.name = f"Object {n}", name
        light.data.light_meshes.shadow_pass = True
    add_light('SUN', energy=1).data.name = "Without"
    found = render(scene)
    shadows = {name for name in found if name != "Combined"}
    assert shadows == {"Shadow Key_001", "Shadow Key_001 (2)", "Shadow __/Rim", "Shadow Füll",
                       "Shadow " + "x" * 50}
    assert all((found[name][24, 32] == 1).all() for name in shadows)


def test_the_pass_follows_the_light_through_another_name(scene, add_plane, add_light, render):
    add_plane(5)
    light = add_light('SUN', energy=1)
    light.data.light_meshes.shadow_pass = True
    light.data.name = "Before"
    assert "Shadow Before" in render(scene)
    light.data.name = "After"
    assert set(render(scene)) == {"Combined", "Shadow After"}


def test_lights_that_share_their_data_share_a_pass(scene, add_plane, add_light, add, render):
    """Objects of one light, one of them in a collection that is instanced: the pass is their mean."""
    add_plane(5)
    add_plane(1, name="Shade", location=(0, 0, 1))
    one = add_light('SUN', energy=1, angle=0)
    one.data.name = "Shared"
    one.data.light_meshes.shadow_pass = True
    collection = bpy.data.collections.new("Lamps")
    low = bpy.data.objects.new("Low", one.data)
    low.rotation_euler = (0, 1.2, 0)
    collection.objects.link(low)
    add(None, "Instance", instance_type='COLLECTION', instance_collection=collection)
    scene.light_meshes.auto_h, scene.light_meshes.h = False, 0.05
    scene.collection.objects["Shade"].visible_camera = False
    shadow = render(scene)["Shadow Shared"][..., 0]
    assert {0.0, 0.5, 1.0} >= set(np.unique(shadow[20:28, 30:34].round(6))) and shadow[24, 32] == pytest.approx(0.5)
    assert shadow.min() >= 0 and shadow[24, 60] == pytest.approx(1)
    # Where only the collection has it, it is found too.
    bpy.data.objects.remove(one)
    assert "Shadow Shared" in render(scene)


def test_a_light_that_the_view_layer_leaves_out_reaches_nothing(scene, add_plane, add_light, render):
    add_plane(5)
    light = add_light('SUN', energy=1)
    light.data.name = "Hidden"
    light.data.light_meshes.shadow_pass = True
    light.hide_render = True
    assert not render(scene)["Shadow Hidden"].any()


# Holdouts and shadow catchers

def test_object_flags_and_indices_reach_the_engine(scene, add_plane, diffuse, snapshot):
    flags = {"Plain": {}, "Hole": {"is_holdout": True}, "Catcher": {"is_shadow_catcher": True},
             "Numbered": {"pass_index": 42}, "Collected": {}, "Indirect": {}}
    for name, values in flags.items():
        add_plane(name=name, **values)
    bpy.data.objects["Plain"].data.materials.append(diffuse())
    bpy.data.materials[0].pass_index = 9
    for name, flag in (("Collected", "holdout"), ("Indirect", "indirect_only")):
        collection = bpy.data.collections.new(name)
        scene.collection.children.link(collection)
        collection.objects.link(bpy.data.objects[name])
        scene.collection.objects.unlink(bpy.data.objects[name])
        setattr(scene.view_layers[0].layer_collection.children[name], flag, True)
    found = snapshot(scene)
    objects = {o.name: o for o in found.objects}
    assert {n for n, o in objects.items() if o.holdout} == {"Hole", "Collected"}
    assert {n for n, o in objects.items() if o.shadow_catcher} == {"Catcher"}
    assert {n for n, o in objects.items() if not o.visible_camera} == {"Indirect"}
    assert {n: o.index for n, o in objects.items() if o.index} == {"Numbered": 42}
    assert [m.index for m in found.materials if m.name == "Diffuse"] == [9]
    assert not found.warnings


def test_holdouts_and_catchers_are_those_of_cycles(scene, add_plane, add_light, diffuse, render, add_mesh):
    """Fully lit, fully shadowed, a hole: the same alpha and light where nothing is a matter of blur."""
    floor = add_plane(20, is_shadow_catcher=True)
    floor.data.materials.append(diffuse())
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    for name, x, flags in (("Box", 0.4, {}), ("Hole", -2.2, {"is_holdout": True})):
        corners = [(i + x, j, k) for i in (-0.8, 0.8) for j in (-1.2, 1.2) for k in (0.9, 1.2)]
        add_mesh(name, corners, sides, **flags).data.materials.append(diffuse((0.6, 0.3, 0.2), name))
    add_light('SUN', energy=3, angle=0, rotation=(0, -0.9, 0))
    scene.render.film_transparent = True
    scene.light_meshes.auto_h, scene.light_meshes.h = False, 0.03
    pictures = {}
    for engine in ('LIGHT_MESHES', 'CYCLES'):
        scene.render.engine = engine
        if engine == 'CYCLES':
            scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 32, False, 0
            scene.cycles.use_adaptive_sampling = False
        pictures[engine] = render(scene)["Combined"]
    ours, cycles = pictures['LIGHT_MESHES'], pictures['CYCLES']
    padded = np.pad(cycles, [(4, 4), (4, 4), (0, 0)], mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, (9, 9), axis=(0, 1))
    flat = np.ptp(around, axis=(3, 4)).max(-1) < 0.01  # farther from an edge than a penumbra reaches
    assert flat.mean() > 0.3
    np.testing.assert_allclose(ours[flat], cycles[flat], atol=0.005)
    print(f"largest difference {np.abs(ours - cycles)[flat].max():.5f} in {flat.sum()} pixels")
    dark = flat & (cycles[..., 3] > 0.99) & (cycles[..., 0] < 0.01)  # catches a shadow
    lit = flat & (cycles[..., 3] > 0.99) & (cycles[..., 0] > 0.1)
    assert dark.sum() > 20 and lit.sum() > 5 and (flat & (cycles[..., 3] < 0.01)).sum() > 300
