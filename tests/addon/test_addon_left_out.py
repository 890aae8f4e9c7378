"""Everything that Cycles shows and the engine does not is named in a warning; features that are off cause no
warning.
"""

import bpy
import numpy as np
import pytest
from exr import write_floats
from light_meshes_addon.export import left_out
from light_meshes_addon.export.report import Report

SHADERS = sorted(set(left_out._READ) - {'ShaderNodeBackground', 'ShaderNodeMixShader'})


def unknown_inputs():
    """Inputs of the translated shaders that neither are read nor are known to be left out, by node."""
    tree = bpy.data.node_groups.new("All", 'ShaderNodeTree')
    found = {}
    for idname, read in left_out._READ.items():
        if not hasattr(bpy.types, idname) or idname == 'ShaderNodeBsdfAnisotropic':
            continue
        known = left_out._LEFT_OUT.get(idname, {})
        names = {s.name for s in tree.nodes.new(idname).inputs if s.type != 'SHADER' and not s.is_unavailable}
        found[idname] = names - read - set(known) - {d for left in known.values() for d in left.details}
    bpy.data.node_groups.remove(tree)
    return found


def test_every_input_of_this_blender_is_known(addon):
    """A new Blender's new input stands out here; the artist hears of it, too, as soon as it is not 0."""
    assert not {idname: names for idname, names in unknown_inputs().items() if names}


@pytest.mark.parametrize("idname", SHADERS)
def test_what_changes_cycles_picture_is_translated_or_named(scene, add_mesh, add_light, node_material, snapshot, idname,
                                                            tmp_path):
    """Each input alone, away from its default: Cycles' picture stays, or ours follows, or a sentence names it."""
    if not hasattr(bpy.types, idname):
        pytest.skip("no such node in this Blender")
    ring = [(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 13)[:-1]]
    dome = add_mesh("Dome", [(2.5 * x, 2.5 * y, 0) for x, y in ring] + [(1.5 * x, 1.5 * y, 1) for x, y in ring] + [
        (0, 0, 1.3)], [(i, (i + 1) % 12, 12 + (i + 1) % 12, 12 + i) for i in range(12)] + [
        (12 + i, 12 + (i + 1) % 12, 24) for i in range(12)])
    for polygon in dome.data.polygons:
        polygon.use_smooth = True
    add_mesh("Behind", [(0, -3, -1), (3, -3, -1), (3, 3, -1), (0, 3, -1)], [(0, 1, 2, 3)])
    add_light('POINT', location=(2, 2, 5), energy=300, shadow_soft_size=1)
    scene.world = bpy.data.worlds.new("Grey")
    material = node_material("Subject", idname)
    dome.data.materials.append(material)
    node = next(n for n in material.node_tree.nodes if n.outputs)
    base, described = cycles(scene, tmp_path), snapshot(scene)
    assert described.warnings == ()
    changed = 0
    for socket in node.inputs:
        if socket.hide_value or socket.is_unavailable or not hasattr(socket, "default_value"):
            continue
        before = socket.default_value if isinstance(socket.default_value, bool | int | float) else tuple(
            socket.default_value)
        socket.default_value = different(socket)
        if np.abs(cycles(scene, tmp_path) - base).max() > 1e-4:
            changed += 1
            found = snapshot(scene)
            named = any(f"'{socket.name}'" in w and "'Subject'" in w for w in found.warnings)
            ours = [[m for m in f.materials if m.name == "Subject"] for f in (found, described)]
            assert named or ours[0] != ours[1], socket.name
        else:
            assert snapshot(scene).warnings == (), socket.name  # a detail of what is off
        socket.default_value = before
    assert changed >= 1


def different(socket):
    if socket.type == 'BOOLEAN':
        return not socket.default_value
    if socket.type in {'RGBA', 'VECTOR'}:
        return (0.9, 0.35, 0.2, 1)[:len(socket.default_value)]
    return {"Thin Film Thickness": 400.0, "IOR": 1.8, "Strength": 3.0}.get(socket.name, 0.7)


def cycles(scene, folder):
    """A small picture by Cycles, always with the same random numbers."""
    import OpenImageIO as oiio

    path = str(folder / "cycles.exr")
    write_floats(scene, path)
    scene.render.engine = 'CYCLES'
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.device = 4, False, 'CPU'
    size = scene.render.resolution_x, scene.render.resolution_y
    scene.render.resolution_x = scene.render.resolution_y = 24
    bpy.ops.render.render(write_still=True)
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.engine = 'LIGHT_MESHES'
    return oiio.ImageBuf(path).get_pixels(oiio.FLOAT)[..., :3]


def test_a_linked_input_is_named_with_the_value_that_is_used(translated, node_material):
    material = node_material("Brushed", 'ShaderNodeBsdfPrincipled', Roughness=0.25)
    tree = material.node_tree
    info, shader = tree.nodes.new('ShaderNodeParticleInfo'), tree.nodes["Principled BSDF"]
    tree.links.new(info.outputs[0], shader.inputs["Roughness"])
    tree.links.new(info.outputs[0], shader.inputs["Anisotropic"])
    _, found = translated(material)
    assert len(found.warnings) == 2 and any("'Anisotropic'" in w for w in found.warnings)
    assert any("Particle Info" in w and w.endswith("'Roughness' of 'Principled BSDF' is used: 0.25")
               for w in found.warnings)


def test_warnings_of_one_kind_are_one_sentence(scene, add_plane, add_light, node_material, snapshot):
    add_light('SUN')
    for i in range(25):
        material = node_material(f"M{i}", 'ShaderNodeBsdfPrincipled', Roughness=i / 100)
        tree = material.node_tree
        info = tree.nodes.new('ShaderNodeParticleInfo')
        info.name = f"Particle Info.{i:03}"
        tree.links.new(info.outputs[0], tree.nodes["Principled BSDF"].inputs["Roughness"])
        add_plane().data.materials.append(material)
    assert snapshot(scene).warnings == (
        "In 25 materials: node 'Particle Info' is not translated; the value in 'Roughness' of 'Principled BSDF' is "
        "used: 'M0' (0), 'M1' (0.01), 'M2' (0.02) and 22 more",)


def test_reports_add_up():
    report, other = Report(), Report()
    report.warn("it is broken", "Object", "A")
    report.warn("All is well")
    other.warn("it is broken", "Object", "B", "instead of 2")
    for _ in range(2):
        report.add(other)
    assert report.sentences == ["In 2 objects: it is broken: 'A' and 'B' (instead of 2)", "All is well"]
    assert other.sentences == ["Object 'B': it is broken: instead of 2"]


def volume_only(name="Fog"):
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    node = tree.nodes.new('ShaderNodeVolumePrincipled')
    node.inputs["Density"].default_value = 1e-6
    tree.links.new(node.outputs[0], tree.nodes.new('ShaderNodeOutputMaterial').inputs["Volume"])
    return material


@pytest.mark.parametrize("shadows", ['SHARP', 'LIGHT_MESHES'])
def test_a_volume_alone_is_no_surface(scene, add_plane, add_mesh, add_light, render, snapshot, shadows, tmp_path):
    add_plane(8)
    box = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (0, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    add_mesh("Cube", box, faces)
    add_light('SUN', rotation=(0.6, 0.3, 0), energy=3, angle=0)
    scene.light_meshes.shadows = shadows
    without, by_cycles = render(scene)["Combined"], cycles(scene, tmp_path)
    fog = add_mesh("Fog", [tuple(4 * c for c in v) for v in box], faces)
    fog.data.materials.append(volume_only())
    np.testing.assert_array_equal(render(scene)["Combined"], without)
    assert cycles(scene, tmp_path).mean() == pytest.approx(by_cycles.mean(), rel=0.05)  # nor is so thin a fog there
    (said,) = snapshot(scene).warnings
    assert "'Fog'" in said and "without volume" in said


def test_a_worlds_volume_is_named(scene, add_plane, snapshot):
    add_plane()
    world = scene.world = bpy.data.worlds.new("Haze")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    tree = world.node_tree
    output = next(n for n in tree.nodes if n.bl_idname == 'ShaderNodeOutputWorld')
    tree.links.new(tree.nodes.new('ShaderNodeVolumeScatter').outputs[0], output.inputs["Volume"])
    (said,) = snapshot(scene).warnings
    assert said.startswith("World 'Haze': ") and "Volume Scatter" in said and "without volume" in said


@pytest.mark.parametrize(("path", "value", "word"), [
    ("scene.cycles.film_exposure", 2.0, "Exposure"), ("scene.cycles.sample_clamp_direct", 1.0, "Clamping"),
    ("layer.use_sky", False, "Include Environment"), ("layer.use_solid", False, "Include Surfaces"),
    ("plane.visible_transmission", False, "Ray Visibility: Transmission"),
    ("scene.render.use_motion_blur", True, "Motion Blur"),
])
def test_settings_that_cycles_follows_are_named(scene, add_plane, snapshot, path, value, word):
    plane = add_plane()
    scene.world = bpy.data.worlds.new("World")
    assert snapshot(scene).warnings == ()
    owner = {"scene": scene, "layer": scene.view_layers[0], "plane": plane}[path.split(".")[0]]
    for name in path.split(".")[1:-1]:
        owner = getattr(owner, name)
    setattr(owner, path.split(".")[-1], value)
    (said,) = snapshot(scene).warnings
    assert word in said


def test_fresnel_of_a_plastic_follows_its_ior(translated, node_material):
    shine = [translated(node_material(f"I{ior}", 'ShaderNodeBsdfPrincipled', IOR=ior))[0].ks for ior in (1.5, 2.0, 1.0)]
    assert shine[1] / shine[0] == pytest.approx((1 / 3) ** 2 / 0.04) and shine[2] == 0


@pytest.mark.parametrize(("what", "words"), [
    ("none", "add one"), ("hidden", "show those that are hidden"), ("excluded", "show those that are hidden"),
    ("energy", "'Sun' is 0"), ("black", "'Sun' is 0"), ("emitter", "surfaces with emission light nothing else"),
])
def test_a_scene_without_light_says_what_to_do(scene, add_plane, add_light, node_material, render, capfd, what, words):
    add_plane()
    if what == "emitter":
        add_plane(name="Panel", location=(2, 0, 1)).data.materials.append(
            node_material("Panel", 'ShaderNodeEmission', Strength=5))
    elif what != "none":
        lamp = add_light('SUN', energy=0 if what == "energy" else 3, color=(0, 0, 0) if what == "black" else (1, 1, 1))
        if what == "excluded":
            hidden = bpy.data.collections.new("Hidden")
            scene.collection.children.link(hidden)
            scene.collection.objects.unlink(lamp)
            hidden.objects.link(lamp)
            scene.view_layers[0].layer_collection.children["Hidden"].exclude = True
        lamp.hide_render = what == "hidden"
    render(scene)
    said = [line for line in capfd.readouterr().out.splitlines() if line.startswith("Warning: ")]
    assert len(said) == 1 and "No lamp lights the scene" in said[0] and words in said[0], said


@pytest.mark.parametrize("kind", ['ShaderNodeEmission', 'ShaderNodeBsdfTransparent'])
def test_nothing_is_said_where_nothing_wants_light(scene, add_plane, node_material, render, capfd, kind):
    add_plane().data.materials.append(node_material("Screen", kind))
    render(scene)
    assert "No lamp" not in capfd.readouterr().out
