"""The shadow terminator is the same as in Cycles: smooth meshes with few faces at grazing light, pixel by pixel."""

import random

import bmesh
import bpy
import numpy as np
import pytest


def made(build):
    """A smooth mesh that `build` makes with bmesh."""
    mesh, work = bpy.data.meshes.new("Smooth"), bmesh.new()
    build(work)
    work.to_mesh(mesh)
    work.free()
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    return mesh


def hills():
    chance, n = random.Random(2), 10
    vertices = [((x - n / 2) / 4, (y - n / 2) / 4, chance.uniform(0, 0.22)) for y in range(n + 1) for x in range(n + 1)]
    first = [i * (n + 1) + j for i in range(n) for j in range(n)]
    mesh = bpy.data.meshes.new("Hills")
    mesh.from_pydata(vertices, [], [(a, a + 1, a + n + 2, a + n + 1) for a in first])
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    return mesh


MESHES = {
    "sphere": lambda: made(lambda b: bmesh.ops.create_uvsphere(b, u_segments=32, v_segments=16, radius=1)),
    "monkey": lambda: made(lambda b: bmesh.ops.create_monkey(b)),
    "hills": hills,
    "ball of few faces": lambda: made(lambda b: bmesh.ops.create_icosphere(b, subdivisions=2, radius=1)),
    "cone with a sharp rim": lambda: made(lambda b: bmesh.ops.create_cone(
        b, cap_ends=True, segments=12, radius1=1, radius2=0.4, depth=2)),
}
PLACES = {
    "as it is": {},
    "mirrored": {"scale": (-1, 1, 1)},
    "squeezed": {"scale": (1.3, 0.6, 1), "rotation_euler": (0.3, 0.2, 0.5)},
}


def put(ob, name, value):
    """Set one of the object's offsets, which 4.2 has among Cycles' own properties."""
    if hasattr(ob, name):
        setattr(ob, name, value)
    else:
        setattr(ob.cycles, name.replace("_shading", ""), value)


@pytest.fixture
def both(scene, add, add_light, diffuse, render, look_at):
    """(mesh, where it stands, shadows, properties) → our picture and Cycles'.

    One ray through the middle of a pixel; with a size of the sun many through its filter.
    """
    def run(mesh, place, shadows="SHARP", size=0.0, **properties):
        ob = add(mesh, "Smooth", **place)
        ob.data.materials.append(diffuse())
        for name, value in properties.items():
            put(ob, name, value)
        add_light('SUN', energy=3, angle=size, rotation=(0.3, 1.3, 0))
        scene.render.resolution_x = scene.render.resolution_y = 120
        scene.camera.location, scene.camera.data.lens = (0, -5, 3), 70
        look_at(scene.camera, (0, 0, 0))
        ours, cycles = scene.light_meshes, scene.cycles
        ours.shadows, ours.samples, ours.mode = shadows, 64 if size else 1, 'RAY_CASTING'
        ours.light_samples, ours.bounces = 16, 0
        cycles.samples, cycles.max_bounces, cycles.sample_clamp_direct = 64 if size else 1, 0, 0
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        if not size:
            cycles.pixel_filter_type, cycles.filter_width = 'BOX', 0.01
        pictures = []
        for engine in ('LIGHT_MESHES', 'CYCLES'):
            scene.render.engine = engine
            pictures.append(render(scene)["Combined"][..., 0].astype(float))
        return pictures
    return run


def black(ours, theirs):
    """The share of the pixels that Cycles lights which are black in our picture."""
    lit = theirs > 0.02 * theirs.max()
    assert lit.sum() > 1000
    return (ours[lit] < 0.05 * theirs[lit]).mean()


def rms(ours, theirs):
    """The root mean square difference, of the mean of what Cycles lights."""
    return np.sqrt(((ours - theirs)[theirs > 0] ** 2).mean()) / theirs[theirs > 0].mean()


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", MESHES)
def test_sharp_shadows(both, name, place):
    ours, theirs = both(MESHES[name](), PLACES[place])
    assert black(ours, theirs) <= 0.005
    assert rms(ours, theirs) <= 0.06


@pytest.mark.parametrize("name", MESHES)
def test_light_meshes(both, name):
    """The soft edges of what is truly in the shadow are the method's own: they are left out of the difference."""
    ours, theirs = both(MESHES[name](), {}, "LIGHT_MESHES")
    assert black(ours, theirs) <= 0.005
    edge = np.zeros(theirs.shape, bool)
    for axis in (0, 1):
        for shift in range(-4, 5):
            edge |= np.roll(theirs == 0, shift, axis)
    inside = ~edge
    assert inside.sum() > 500
    assert np.sqrt(((ours - theirs)[inside] ** 2).mean()) / theirs[inside].mean() <= 0.06


def steep_hills():
    """Of the height of their squares: at this light a fifth of what Cycles lights was black in facets."""
    chance, n = random.Random(2), 14
    vertices = [(x - n / 2, y - n / 2, chance.uniform(0, 0.9)) for y in range(n + 1) for x in range(n + 1)]
    first = [i * (n + 1) + j for i in range(n) for j in range(n)]
    mesh = bpy.data.meshes.new("Steep hills")
    mesh.from_pydata(vertices, [], [(a, a + 1, a + n + 2, a + n + 1) for a in first])
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    return mesh


@pytest.fixture
def low_sun(scene, add, add_light, diffuse, render, look_at):
    """(mesh, camera, size of the sun) → a function of shadows and h, 0: automatic, that gives our picture; and Cycles'.

    Both with many samples in the square of a pixel: Cycles' own filter is wider, and lights what is beside an outline.
    """
    def run(mesh, eye, size):
        add(mesh, "Smooth").data.materials.append(diffuse())
        add_light('SUN', energy=3, angle=size, rotation=(0, 1.3, 0))
        scene.render.resolution_x, scene.render.resolution_y = 240, 180
        scene.camera.location = eye
        look_at(scene.camera, (0, 0, 0))
        ours, cycles = scene.light_meshes, scene.cycles
        ours.samples, ours.mode, ours.bounces, cycles.samples, cycles.max_bounces = 16, 'RAY_CASTING', 0, 64, 0
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        cycles.sample_clamp_direct, cycles.pixel_filter_type, cycles.filter_width = 0, 'BOX', 1
        ours.share_samples = False  # which would filter the square, too

        def picture(engine, shadows="SHARP", h=0.0):
            ours.shadows, ours.auto_h = shadows, not h
            if h:
                ours.h, ours.kI = h, 2
            scene.render.engine = engine
            return render(scene)["Combined"][..., 0].astype(float)
        return lambda *values: picture('LIGHT_MESHES', *values), picture('CYCLES')
    return run


LOW = {"steep hills": (steep_hills, (0, -9, 6)), "monkey": (MESHES["monkey"], (0, -4, 2.5)),
       "sphere": (MESHES["sphere"], (0, -4, 2.5)), "ball of few faces": (MESHES["ball of few faces"], (0, -4, 2.5)),
       "cone with a sharp rim": (MESHES["cone with a sharp rim"], (0, -4, 2.5))}


@pytest.mark.parametrize("name", LOW)
def test_a_low_sun(low_sun, name):
    """The issue's own bounds, 15° above the ground, against lamps that match: sharp shadows and a sun without a size,
    and at the automatic step nothing that a small sun lights is black.
    """
    build, eye = LOW[name]
    ours, theirs = low_sun(build(), eye, 0.0)
    sharp, soft = ours("SHARP"), ours("LIGHT_MESHES")
    assert black(sharp, theirs) <= 0.005 and rms(sharp, theirs) <= 0.06
    assert black(soft, theirs) <= 0.005


@pytest.mark.parametrize("name", ["steep hills", "monkey"])
def test_what_is_left_in_soft_shadows_is_their_width(low_sun, name):
    """The blur of edges under low light, r·cot β: it falls with h, towards what sharp shadows leave."""
    build, eye = LOW[name]
    ours, theirs = low_sun(build(), eye, 0.0)
    left = [rms(ours("LIGHT_MESHES", h), theirs) for h in (0.03, 0.015, 0.0075)]
    print(f"{name}: RMS difference {np.round(left, 3)} of the mean, of sharp shadows {rms(ours('SHARP'), theirs):.3f}")
    assert left[0] > 1.1 * left[1] > 1.1**2 * left[2] and left[2] <= 0.06


SIZED = {"the default size of a low sun": ('SUN', {"angle": 0.05, "rotation": (0, 1.3, 0)}),
         "a higher sun": ('SUN', {"angle": 0.05, "rotation": (0, 0.9, 0)}),
         "a wide sun": ('SUN', {"angle": 0.6, "rotation": (0, 1.3, 0)}),
         "a bulb": ('POINT', {"energy": 300, "shadow_soft_size": 0.5, "location": (3.5, 0, 1.0)}),
         "a softbox": ('AREA', {"energy": 300, "size": 2.0, "location": (9, 0, 3), "rotation": (0, 1.2, 0)})}


@pytest.fixture
def whole_lamp(scene, add, add_light, diffuse, render, look_at):
    """(mesh, camera, lamp of SIZED) → a function of an engine and its samples that gives a picture."""
    def run(mesh, eye, name, shadows='LIGHT_MESHES'):
        add(mesh, "Smooth").data.materials.append(diffuse())
        kind, values = SIZED[name]
        lamp = add_light(kind, **{"energy": 3} | values)
        lamp.data.light_meshes.softness = 'SIZE'
        scene.render.resolution_x, scene.render.resolution_y = 120, 90
        scene.camera.location = eye
        look_at(scene.camera, (0, 0, 0))
        ours, cycles = scene.light_meshes, scene.cycles
        ours.mode, ours.shadows, ours.light_samples, ours.bounces, cycles.max_bounces = 'RAY_CASTING', shadows, 16, 0, 0
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        cycles.sample_clamp_direct, cycles.pixel_filter_type, cycles.filter_width = 0, 'BOX', 1
        ours.share_samples = False  # which would filter the square, too

        def picture(engine, samples):
            ours.samples = cycles.samples = samples
            scene.render.engine = engine
            return render(scene)["Combined"][..., 0].astype(float)
        return picture
    return run


@pytest.mark.parametrize(("name", "lamp"), [*((name, "the default size of a low sun") for name in LOW),
                                            ("steep hills", "a wide sun"), ("monkey", "a wide sun")])
def test_lamps_with_a_size(whole_lamp, name, lamp):
    """The issue's own bounds, with the softness of a new lamp."""
    build, eye = LOW[name]
    picture = whole_lamp(build(), eye, lamp)
    ours, theirs = picture('LIGHT_MESHES', 16), picture('CYCLES', 64)
    print(f"{name}, {lamp}: black {black(ours, theirs):.3%}, RMS {rms(ours, theirs):.3f}")
    assert black(ours, theirs) <= 0.005
    assert rms(ours, theirs) <= 0.06


@pytest.mark.parametrize(("lamp", "shadows"), [("a higher sun", 'LIGHT_MESHES'), ("a bulb", 'LIGHT_MESHES'),
                                               ("a bulb", 'AREA_SAMPLING'), ("a softbox", 'LIGHT_MESHES')])
def test_facets_hide_no_part_of_a_lamp(whole_lamp, lamp, shadows):
    """A facet that is turned from a part of the lamp only: that part is seen from above it, as in Cycles. (Whole facets
    were too dark, RMS .08 in the light of the bulb.)"""
    picture = whole_lamp(steep_hills(), (0, -9, 6), lamp, shadows)
    ours, theirs = picture('LIGHT_MESHES', 16), picture('CYCLES', 256)
    print(f"{lamp}, {shadows}: black {black(ours, theirs):.3%}, RMS {rms(ours, theirs):.3f}")
    assert black(ours, theirs) <= 0.005
    assert rms(ours, theirs) <= 0.05
    assert abs(ours.mean() / theirs.mean() - 1) <= 0.003


def test_few_samples_miss_what_is_narrower_than_a_pixel(whole_lamp):
    """With 4 samples a pixel 1.2 % are black on steep hills, along outlines and ridges; of Cycles' own 4, 2 %."""
    picture = whole_lamp(steep_hills(), (0, -9, 6), "the default size of a low sun")
    theirs = picture('CYCLES', 64)
    assert black(picture('LIGHT_MESHES', 4), theirs) <= black(picture('CYCLES', 4), theirs)


def test_area_sampling(both):
    ours, theirs = both(MESHES["hills"](), {}, "AREA_SAMPLING", size=0.05)
    assert black(ours, theirs) <= 0.005
    assert rms(ours, theirs) <= 0.06


@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
def test_without_the_offset_facets_are_black_in_both(both, shadows):
    ours, theirs = both(MESHES["ball of few faces"](), {}, shadows, shadow_terminator_geometry_offset=0.0)
    assert rms(ours, theirs) <= 0.06
    for ob in bpy.context.scene.objects:
        ob.hide_render = ob.type != 'CAMERA'
    _, smooth = both(MESHES["ball of few faces"](), {}, shadows)
    assert black(ours, smooth) > 0.03


@pytest.mark.parametrize("offset", [0.3, 1.0])
def test_the_shading_offset(both, offset):
    ours, theirs = both(MESHES["sphere"](), {}, shadow_terminator_shading_offset=offset)
    lit = theirs > 0.02 * theirs.max()
    assert np.median(np.abs(ours - theirs)[lit] / theirs[lit]) < 0.01
    assert rms(ours, theirs) <= 0.06


def test_the_offsets_reach_the_engine(scene, add, snapshot):
    ob = add(MESHES["sphere"]())
    found = snapshot(scene).objects[0]
    assert found.shadow_terminator_geometry_offset == pytest.approx(0.1)  # Cycles' default
    assert found.shadow_terminator_normal_offset == found.shadow_terminator_shading_offset == 0
    put(ob, "shadow_terminator_geometry_offset", 0.4)
    put(ob, "shadow_terminator_shading_offset", 0.3)
    if hasattr(ob, "shadow_terminator_normal_offset"):
        ob.shadow_terminator_normal_offset = 2
    found = snapshot(scene).objects[0]
    assert found.shadow_terminator_geometry_offset == pytest.approx(0.4)
    assert found.shadow_terminator_shading_offset == pytest.approx(0.3)
    assert found.shadow_terminator_normal_offset == (2 if hasattr(ob, "shadow_terminator_normal_offset") else 0)
