"""Lamps that are scaled, sheared, mirrored, instanced or switched off give the same light as in Cycles, within 1 %."""

import math

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

TURN = Euler((0.3, 0.2, 0.4)).to_matrix().to_4x4()
SHEAR = Matrix(((1, 0.4, 0.1, 0), (0.1, 1, 0.2, 0), (0.1, 0.2, 1, 0), (0, 0, 0, 1)))
SPOT = {"spot_size": 1.2, "energy": 600}
# Kind, properties of the lamp (those of its object too), and its matrix beside the place.
STRETCHED = {
    "spot, wider": ('SPOT', SPOT, (2, 2, 1)),
    "spot, narrower, blended": ('SPOT', SPOT | {"spot_blend": 1.0}, (1, 1, 3)),
    "spot, half as wide": ('SPOT', SPOT | {"spot_blend": 0.5}, (0.5, 0.5, 1)),
    "spot, elliptic": ('SPOT', SPOT | {"spot_blend": 0.5}, (1.5, 0.7, 1)),
    "spot, elliptic, hard": ('SPOT', SPOT | {"spot_blend": 0.0}, (-2, 0.5, 1)),
    "spot, of half a space": ('SPOT', SPOT | {"spot_size": math.pi, "spot_blend": 0.5}, (1, 1, 2)),
    "spot, sheared": ('SPOT', SPOT | {"spot_blend": 1.0}, SHEAR),
    "spot, mirrored and sheared": ('SPOT', SPOT | {"spot_blend": 0.5}, SHEAR @ Matrix.Diagonal((-1, 1, 1, 1))),
    "point, sheared": ('POINT', {}, SHEAR),
    "point, flat": ('POINT', {}, (1, 1, 0)),
    "sun, sheared": ('SUN', {}, SHEAR),
    "sun, scaled": ('SUN', {}, (3, -2, 0.5)),
    "sun, without width": ('SUN', {}, (0, 1, 1)),
    "area, stretched": ('AREA', {}, (2, 0.5, 1)),
    "area, mirrored": ('AREA', {}, (-1, 1, 1)),
    "area, sheared": ('AREA', {}, SHEAR),
    "area, sheared rectangle": ('AREA', {"shape": 'RECTANGLE', "size_y": 0.03}, SHEAR),
    "area, sheared disk": ('AREA', {"shape": 'DISK'}, SHEAR),
    "area, sheared and mirrored": ('AREA', {}, SHEAR @ Matrix.Diagonal((-1, 1.5, 1, 1))),
    "area, leaning": ('AREA', {}, Matrix(((1, 0, 0.3, 0), (0, 1, 0.2, 0), (0, 0, 1, 0), (0, 0, 0, 1)))),
    "point, custom distance": ('POINT', {"use_custom_distance": True, "cutoff_distance": 1.0}, (1, 1, 1)),
    "point, EEVEE's factors": ('POINT', {
        "diffuse_factor": 0.3, "specular_factor": 0.2, "volume_factor": 0.5, "transmission_factor": 0.5}, (1, 1, 1)),
    "point, no shadow": ('POINT', {"use_shadow": False}, (1, 1, 1)),
    "point, unseen": ('POINT', {"visible_camera": False, "visible_shadow": False, "is_holdout": True}, (1, 1, 1)),
}
OFF = {
    "area, portal": ('AREA', {"is_portal": True}, (1, 1, 1)),
    "area, without depth": ('AREA', {}, (1, 1, 0)),
    "area, without width": ('AREA', {}, (0, 1, 1)),
    "area, of size 0": ('AREA', {"size": 0}, (1, 1, 1)),
    "disk, of size 0": ('AREA', {"size": 0, "shape": 'DISK'}, (1, 1, 1)),
    "area, a line": ('AREA', {"shape": 'RECTANGLE', "size_y": 0}, (1, 1, 1)),
    "spot, a point": ('SPOT', SPOT, (0, 0, 0)),
    "spot, without depth": ('SPOT', SPOT, (1, 1, 0)),
    "sun, a point": ('SUN', {}, (0, 0, 0)),
    "sun, without depth": ('SUN', {}, (1, 1, 0)),
    "point, lights nothing": ('POINT', {"visible_diffuse": False, "visible_glossy": False}, (1, 1, 1)),
    "sun, lights nothing matt": ('SUN', {"visible_diffuse": False}, (1, 1, 1)),
    "spot, upwards": ('SPOT', SPOT, (1, 1, -1)),
    "hidden": ('POINT', {"hide_render": True}, (1, 1, 1)),
}


@pytest.fixture
def lamp(scene, add, add_light):
    """(kind, properties, matrix) → a lamp 4 above the origin: a parent gives it any matrix."""
    def make(kind, properties, matrix, height=4.0):
        if not isinstance(matrix, Matrix):
            matrix = Matrix.Diagonal((*matrix, 1))
        data = {'POINT': {"energy": 300, "shadow_soft_size": 0}, 'SUN': {"energy": 3, "angle": 0},
                'SPOT': {"shadow_soft_size": 0}, 'AREA': {"energy": 300, "size": 0.02}}[kind]
        ob = add_light(kind, location=(0, 0, 0), **data)
        for name, value in properties.items():
            owner = next(o for o in (ob.data, ob, ob.data.cycles) if hasattr(o, name))
            setattr(owner, name, value)
        ob.parent = add(None, "Parent")
        ob.matrix_parent_inverse = Matrix.Translation((0, 0, height)) @ TURN @ matrix
        return ob
    return make


@pytest.fixture
def both(scene, add_plane, diffuse, render, look_at):
    """() → our picture and Cycles' of a floor."""
    def run():
        add_plane(5).data.materials.append(diffuse())
        scene.camera.location = (3, -5, 4)
        look_at(scene.camera, (0, 0, 0))
        ours, cycles = scene.light_meshes, scene.cycles
        ours.shadows, ours.samples, ours.mode = 'SHARP', 1, 'RAY_CASTING'
        cycles.samples, cycles.max_bounces, cycles.sample_clamp_direct = 16, 0, 0
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        cycles.pixel_filter_type, cycles.filter_width = 'BOX', 0.01
        pictures = []
        for engine in ('LIGHT_MESHES', 'CYCLES'):
            scene.render.engine = engine
            pictures.append(render(scene)["Combined"][..., :3].max(2).astype(float))
        return pictures
    return run


@pytest.fixture
def compared(both):
    """() → of ours/Cycles the median, nearly the least and the most, and of how many pixels: lit, and off edges."""
    def run():
        a, b = both()
        around = np.lib.stride_tricks.sliding_window_view(np.pad(b, 1, mode="edge"), (3, 3))
        inside = (around.max((2, 3)) < 1.5 * around.min((2, 3))) & (b > 0.01 * b.max())
        ratio = a[inside] / b[inside]
        return np.median(ratio), np.quantile(ratio, (0.1, 0.9)), inside.sum()
    return run


@pytest.mark.parametrize("name", STRETCHED)
def test_stretched_and_sheared(lamp, compared, name):
    lamp(*STRETCHED[name])
    median, (low, high), count = compared()
    assert count > 100 or name == "spot, narrower, blended"
    assert median == pytest.approx(1, abs=0.01) and low > 0.98 and high < 1.02


@pytest.mark.parametrize("name", OFF)
def test_off(lamp, both, add_light, name):
    """Beside another lamp, as Cycles may crash where none is on; its noise is what it tries of those that are off."""
    lamp(*OFF[name])
    add_light('POINT', energy=200, shadow_soft_size=0)
    ours, theirs = both()
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.03)


@pytest.mark.parametrize("engine", ['LIGHT_MESHES', 'CYCLES'])
@pytest.mark.parametrize(("off", "shader"), [
    ("visible_diffuse", 'ShaderNodeBsdfDiffuse'), ("visible_glossy", 'ShaderNodeBsdfGlossy')])
def test_what_a_lamp_does_not_light_is_black(
        scene, lamp, add_plane, node_material, render, look_at, off, shader, engine):
    ob = lamp('AREA', {}, (1, 1, 1))
    add_plane(5).data.materials.append(node_material("Floor", shader, Roughness=0.5))
    scene.camera.location = (2, -3, 4)
    look_at(scene.camera, (0, 0, 0))
    scene.render.engine = engine
    scene.cycles.samples, scene.cycles.max_bounces, scene.light_meshes.samples = 4, 0, 1
    scene.cycles.use_denoising = False
    for flag in ("visible_diffuse", "visible_glossy"):
        ob.visible_diffuse = ob.visible_glossy = True
        setattr(ob, flag, False)
        assert (render(scene)["Combined"][..., :3].max() > 0) == (flag != off)


@pytest.mark.parametrize("kind", ['POINT', 'SUN', 'SPOT', 'AREA'])
def test_flags_reach_the_two_terms(scene, lamp, add_plane, node_material, render, look_at, kind):
    """Diffuse and glossy light add up to all of it, and each is switched off by itself."""
    ob = lamp(kind, SPOT if kind == 'SPOT' else {}, (1, 1, 1))
    add_plane(5).data.materials.append(node_material("Both", 'ShaderNodeBsdfPrincipled', Roughness=0.4))
    scene.camera.location = (2, -3, 4)
    look_at(scene.camera, (0, 0, 0))
    scene.light_meshes.samples, scene.light_meshes.shadows = 1, 'LIGHT_MESHES'
    pictures = {}
    for matt in (True, False):
        for gloss in (True, False):
            ob.visible_diffuse, ob.visible_glossy = matt, gloss
            pictures[matt, gloss] = render(scene)["Combined"][..., :3]
    assert (pictures[False, False] == 0).all()
    assert pictures[True, False].max() > 0.01 and pictures[False, True].max() > 1e-4
    both = pictures[True, False] + pictures[False, True]
    np.testing.assert_allclose(both, pictures[True, True], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("switch", ["", "parent", "lamp"])
def test_instanced(scene, lamp, add, add_light, compared, switch):
    """Lamps of a collection that is instanced, scaled unevenly; either object's switches count."""
    ob = lamp('SPOT', SPOT | {"spot_blend": 0.5}, (1.5, 1, 1), height=1.0)
    collection = bpy.data.collections.new("Lamps")
    for thing in (ob, ob.parent):
        scene.collection.objects.unlink(thing)
        collection.objects.link(thing)
    empty = add(None, "Instancer", instance_type='COLLECTION', instance_collection=collection, location=(0, 0, 3),
                scale=(1.2, 0.8, 1.1), rotation_euler=(0.1, 0.2, 0))
    if switch:
        (empty if switch == "parent" else ob).visible_diffuse = False
        add_light('POINT', energy=3, shadow_soft_size=0)
    median, _, count = compared()
    assert count > 300 and median == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("switch", ["holdout", "indirect_only", "exclude"])
def test_in_a_collection_of_the_view_layer(scene, lamp, add_light, compared, switch):
    ob = lamp('POINT', {}, (1, 1, 1))
    collection = bpy.data.collections.new("Lamps")
    scene.collection.children.link(collection)
    scene.collection.objects.unlink(ob)
    collection.objects.link(ob)
    setattr(scene.view_layers[0].layer_collection.children[0], switch, True)
    add_light('POINT', energy=3, shadow_soft_size=0)
    median, _, count = compared()
    assert count > 1000 and median == pytest.approx(1, abs=0.01)


def test_what_is_not_translated_is_named(lamp, snapshot, scene):
    lamp('POINT', {"visible_transmission": False}, (1, 1, 1)).name = "Lamp"
    lamp('AREA', {"spread": 1.0}, SHEAR).data.name = "Softbox"
    whole = lamp('AREA', {"size": 1.0}, SHEAR).data
    whole.name, whole.light_meshes.softness = "Whole", 'SIZE'
    said = snapshot(scene).warnings
    assert any("Transmission is off, but its light passes through glass" in w and "'Lamp'" in w for w in said)
    assert [w for w in said if "it is sheared" in w and "'Softbox'" in w] == [
        w for w in said if "its spread is rendered as if it were not" in w]
    assert [w for w in said if "it is sheared" in w and "'Whole'" in w] == [
        w for w in said if "close to it its light differs from Cycles'" in w] != []


def test_a_round_spot_keeps_its_description(lamp, snapshot, scene):
    lamp('SPOT', SPOT, (2, -2, 2))
    assert snapshot(scene).lights[0].axes is None
