"""Data kept from one picture to the next: the bits are the same as from scratch, and no ray is traced twice.

Each test draws two pictures: `first`, and then `second` with everything of the first that is still valid.
"""

import itertools
import threading
from dataclasses import replace

import numpy as np
import pytest
from kept import PASSES, WIDTH, after, drawn, moved, room, with_camera, with_light, with_material, with_object
from light_meshes import Camera, Shape, box, sphere, translate
from light_meshes.film.images import Framebuffer
from light_meshes.picture import reuse
from light_meshes.picture.render import Cancelled, draw, prepare, render_image
from light_meshes.scene.description import Material, Object, Scene, same
from scenes import GREY, four_lights, hall, point, with_lights


@pytest.fixture(scope="module")
def still_life() -> Scene:
    """Floor, ball and box under one light of each type."""
    return four_lights(WIDTH)

# --- The camera -------------------------------------------------------------------------------------------

def test_the_same_picture_again_traces_no_node(still_life):
    kept, fresh, before, now = after(still_life, still_life)
    assert kept["long_rays"] == 0 and kept["nodes_kept"] == kept["nodes"] == fresh["nodes"]
    assert now.surfaces is before.surfaces and now.glass is before.glass
    assert now.tracer.built.keys() == before.tracer.built.keys()
    assert all(now.tracer.built[k] is before.tracer.built[k] for k in now.tracer.built)


def test_a_flight_is_made_of_the_same_pictures_and_traces_each_node_once(still_life):
    ready, rays, frames = None, 0, 6
    for n in range(frames):
        scene = with_camera(still_life, (2.5 + 0.1 * n, -4.5, 3.0 - 0.1 * n))
        kept, ready = drawn(scene, ready)
        fresh = render_image(scene, PASSES)
        for name in PASSES:
            np.testing.assert_array_equal(kept.passes[name], fresh.passes[name])
        rays += kept.statistics["long_rays"]
        assert n == 0 or kept.statistics["long_rays"] < 0.5 * fresh.statistics["long_rays"]
    # What the flight has traced is what one store knows at its end: every value once.
    known = ready.soft.store.known
    assert rays == np.unpackbits(np.ascontiguousarray(known).view(np.uint8)).sum()


def test_equal_scenes_are_equal_whoever_made_them(still_life):
    """Contents count, not identity: another run of the exporter."""
    again = four_lights(WIDTH)
    assert again.geometry.vertices is not still_life.geometry.vertices
    kept, _, before, now = after(still_life, again)
    assert kept["long_rays"] == 0
    assert now.scene.geometry is before.scene.geometry  # one copy in memory


def test_another_camera_for_the_rays_leaves_h_as_it_was_measured(still_life):
    scene = still_life.with_settings(auto_h=True)
    ready = prepare(scene, PASSES)
    near = prepare(scene, PASSES, previous=ready, camera=with_camera(scene, (1.0, -1.5, 1.2)).camera)
    assert near.scene.settings.h == ready.scene.settings.h
    assert near.scene.settings.h == prepare(scene, PASSES, camera=near.scene.camera).scene.settings.h
    moved = prepare(with_camera(scene, (1.0, -1.5, 1.2)), PASSES, previous=near)
    assert moved.scene.settings.h < ready.scene.settings.h


# --- Lights -----------------------------------------------------------------------------------------------

def test_a_colour_is_no_reason_to_trace(still_life):
    second = with_light(with_light(still_life, 0, intensity=(1.0, 5.0, 9.0)), 1, intensity=(0.1, 0.1, 0.5))
    kept, *_ = after(still_life, second)
    assert kept["long_rays"] == 0


@pytest.mark.parametrize("i", range(4))
def test_a_moved_light_drops_its_own_values_only(still_life, i):
    light = still_life.lights[i]
    change = {"direction": (0.0, 0.6, -0.8)} if light.type == "SUN" else {
        "position": tuple(np.add(light.position, (0.3, -0.2, 0.1)).tolist())}
    second = with_light(still_life, i, **change)
    kept, fresh, *_ = after(still_life, second)
    alone = render_image(with_lights(second, second.lights[i]), PASSES).statistics
    assert kept["long_rays"] == alone["long_rays"] > 0
    assert kept["long_rays"] < fresh["long_rays"]


def test_lights_may_come_go_and_change_places(still_life):
    a, b, c, d = still_life.lights
    extra = point((0.0, -1.0, 3.0), 2.0, name="extra")
    kept, *_ = after(still_life, with_lights(still_life, d, b, a, c))
    assert kept["long_rays"] == 0
    kept, *_ = after(still_life, with_lights(still_life, c, a))
    assert kept["long_rays"] == 0
    kept, *_ = after(still_life, with_lights(still_life, c, extra, a, d, b))
    assert kept["long_rays"] == render_image(with_lights(still_life, extra), PASSES).statistics["long_rays"] > 0
    # Two at one place see the same.
    kept, *_ = after(still_life, with_lights(still_life, a, b, c, d, replace(a, name="twin")))
    assert kept["long_rays"] == 0


@pytest.mark.parametrize(("before", "now"), [(100, 63), (63, 100), (65, 64), (64, 130)])
def test_many_lights_keep_their_places_in_the_words(before, now):
    first = hall(now, width=24)
    order = np.random.default_rng(0).permutation(now)
    first = hall(max(before, now), columns=2, width=24, h=0.2)
    few = with_lights(first, *first.lights[:before])
    other = with_lights(first, *(first.lights[i] for i in order))
    kept, fresh, *_ = after(few, other)
    if now <= before:
        assert kept["long_rays"] == 0
    else:
        assert 0 < kept["long_rays"] < fresh["long_rays"]


def test_a_shadow_turned_off_and_on_again_and_a_light_made_sharp(still_life):
    for change in ({"cast_shadow": False}, {"soft_shadows": False}):
        other = with_light(still_life, 0, **change)
        kept, *_ = after(still_life, other)
        assert kept["long_rays"] == 0
        kept, fresh, *_ = after(other, still_life)
        assert 0 < kept["long_rays"] < fresh["long_rays"]


# --- The lattice ------------------------------------------------------------------------------------------

def test_the_radius_changes_no_node(still_life):
    kept, fresh, *_ = after(still_life, still_life.with_settings(kI=4.0))
    assert 0 < kept["long_rays"] < fresh["long_rays"]
    kept, *_ = after(still_life, still_life.with_settings(kI=2.0))
    assert kept["long_rays"] == 0


@pytest.mark.parametrize("change", [{"h": 0.081}, {"lattice_rotation": False}, {"lattice_origin": (0.01, 0.0, 0.0)}])
def test_another_lattice_has_other_nodes(still_life, change):
    kept, fresh, *_ = after(still_life, still_life.with_settings(**change))
    assert kept["long_rays"] == fresh["long_rays"] and kept["nodes_kept"] == 0


@pytest.mark.parametrize("change", [{"samples": 3, "filter_size": 1.5}, {"mode": "WHITTED"}, {"ambient": 0.3},
                                    {"uniform_skip": False}, {"film_transparent": True}])
def test_settings_that_nodes_know_nothing_of(still_life, change):
    kept, fresh, *_ = after(still_life, still_life.with_settings(**change))
    assert kept["nodes_kept"] > 0 and kept["long_rays"] <= 0.1 * fresh["long_rays"]


@pytest.mark.parametrize("change", [{"shadows": "SHARP"}, {"shadows": "AREA_SAMPLING", "light_samples": 4},
                                    {"mode": "LOCAL"}])
def test_other_ways_to_a_shadow_and_back(still_life, change):
    other = still_life.with_settings(**change)
    after(still_life, other)
    after(other, still_life)


def test_a_store_that_grew_too_large_is_dropped(still_life, monkeypatch):
    monkeypatch.setattr(reuse, "KEPT_BYTES", 1000)
    kept, fresh, *_ = after(still_life, still_life)
    assert kept["nodes_kept"] == 0 and kept["long_rays"] == fresh["long_rays"]


@pytest.mark.parametrize("small", [0, reuse.SMALL_BYTES], ids=["stores of any size", "small stores stay"])
def test_a_long_flight_keeps_what_a_few_pictures_need(still_life, monkeypatch, small):
    """And its pictures are those of one that keeps nothing."""
    monkeypatch.setattr(reuse, "SMALL_BYTES", small)
    monkeypatch.setattr(reuse, "KEPT_PICTURES", 1.3)
    ready, counts, needs, drops = None, [], [], 0
    for n in range(20):
        scene = with_camera(still_life, (2.5 + 0.3 * n, -4.5 + 0.2 * n, 3.0))
        kept, ready = drawn(scene, ready)
        counts.append(kept.statistics["nodes"])
        drops += kept.statistics["nodes_kept"] == 0
        if n % 4 == 0 or kept.statistics["nodes_kept"] == 0:
            fresh = render_image(scene, PASSES)
            needs.append(fresh.statistics["nodes"])
            for name in PASSES:
                np.testing.assert_array_equal(kept.passes[name], fresh.passes[name])
    if small:
        assert drops == 1 and max(counts) > 1.4 * max(needs)  # the first picture has nothing to keep
    else:
        assert 1 < drops < 8 and max(counts) < 1.4 * max(needs)


# --- Objects ----------------------------------------------------------------------------------------------

def test_a_moved_object_drops_what_looked_past_it():
    first = room()
    kept, fresh, before, now = after(first, moved(first, 2, (-0.2, 0.1, 0.0)))
    assert (now.surfaces.centre == before.surfaces.centre).all()
    assert 0 < kept["long_rays"] < 0.4 * fresh["long_rays"]


@pytest.mark.parametrize("seed", range(6))
def test_objects_moved_at_random(seed):
    random = np.random.default_rng(seed)
    first = room(Shape(sphere(0.4, 12, 8), GREY, "ball", [translate(0, 0, 0.6)]))
    second = moved(first, 3, random.uniform(-0.5, 0.5, 3))
    second = moved(second, int(random.integers(1, 3)), random.uniform(-0.2, 0.3, 3))
    after(first, with_light(second, 1, position=(1.5, -1.0, 3.5)) if seed % 2 else second)


def test_an_object_may_come_and_go():
    ball = Shape(sphere(0.3, 12, 8), GREY, "ball", [translate(0, 0, 0.4)])
    without, with_ball = room(), room(ball)
    for first, second in ((without, with_ball), (with_ball, without)):
        kept, fresh, *_ = after(first, second)
        assert 0 < kept["long_rays"] < 0.5 * fresh["long_rays"]


def test_an_object_that_moves_the_scenes_bounds_drops_all():
    first = room()
    kept, fresh, *_ = after(first, moved(first, 0, (0.5, 0.0, 0.0)))
    assert kept["nodes_kept"] == 0 and kept["long_rays"] == fresh["long_rays"]


def test_flags_of_objects():
    first = room()
    for flag in ("visible_camera", "visible_reflection"):
        kept, fresh, *_ = after(first, with_object(first, 1, **{flag: False}))
        assert kept["long_rays"] < 0.1 * fresh["long_rays"] and kept["nodes_kept"] > 0  # the floor behind it
    unseen = with_object(first, 1, visible_shadow=False)
    for one, other in ((first, unseen), (unseen, first)):
        kept, fresh, *_ = after(one, other)
        assert 0 < kept["long_rays"] < 0.5 * fresh["long_rays"]


# --- Materials --------------------------------------------------------------------------------------------

def test_a_materials_colours_are_no_reason_to_trace(still_life):
    second = with_material(still_life, 1, Od=(0.9, 0.1, 0.1), kd=0.7, ks=0.1, nShiny=5.0, emission=(0.1, 0.0, 0.0))
    kept, _, before, now = after(still_life, second)
    assert kept["long_rays"] == 0 and now.glass is before.glass


def glassy(**more) -> Material:
    return Material("glass", Od=(0.0, 0.0, 0.0), ka=0.0, kd=0.0, **({"kt": (0.7, 0.7, 0.7)} | more))


def panes(material: Material, **values) -> Scene:
    """`room` with a pane on the left and a slab on the right, of one material."""
    return room(Shape(box((-1.4, -0.5, 0.2), (-1.3, 0.5, 1.0)), material, "pane"),
                Shape(box((0.9, -0.3, 0.2), (1.2, 0.3, 0.7)), material, "slab"), **values)


WAYS = ({}, {"glass": "PAPER"}, {"refraction": "FULL", "h": 0.2}, {"refraction": "FULL", "caustics": "FOCUS", "h": 0.2},
        {"refraction": "FULL", "leak_free": True, "h": 0.2})


@pytest.mark.parametrize("values", WAYS, ids=str)
def test_glass_that_changes(values):
    first = panes(glassy(), **values)
    clear = len(first.materials) - 1
    kept, *_ = after(first, replace(first, camera=Camera.look_at((0.3, -7, 5), (0, 0, 0), 40, WIDTH, WIDTH)))
    assert kept["nodes_kept"] > 0
    opaque = panes(replace(GREY, name="glass"), **values)
    after(opaque, first)
    after(first, opaque)
    for change in ({"kt": (0.4, 0.4, 0.4)}, {"kt": (0.7, 0.4, 0.2)}, {"ior": 1.5}, {"alpha": 0.5}, {"priority": 3},
                   {"transparent_shadow": False}, {"fresnel": True}):
        after(first, with_material(first, clear, **change))


@pytest.mark.parametrize("values", WAYS, ids=str)
def test_glass_that_bends(values):
    bent = panes(glassy(ior=1.5), **values)
    clear = len(bent.materials) - 1
    kept, _, before, now = after(bent, bent)
    assert kept["long_rays"] == 0 and kept["nodes_kept"] == kept["nodes"]
    paths = before.shadowing.refraction
    assert paths is None or now.shadowing.refraction.solvers is paths.solvers
    for change in ({"kt": (0.4, 0.4, 0.4)}, {"ior": 1.3}, {"alpha": 0.5}):
        after(bent, with_material(bent, clear, **change))
    after(bent, moved(bent, 4, (0.1, 0.0, 0.1)))
    after(bent, moved(bent, 1, (0.1, 0.0, 0.0)))
    after(bent, with_object(bent, 3, visible_shadow=False))
    after(bent, with_lights(bent, *bent.lights[::-1]))
    after(bent, with_light(bent, 0, position=(-1.5, -2.0, 4.0)))
    after(bent, bent.with_settings(kI=4.0))
    after(bent, bent.with_settings(refraction="NONE"))


def test_values_beside_glass_stay_where_something_moves():
    first = panes(glassy())
    kept, fresh, *_ = after(first, moved(first, 2, (0.1, 0.0, 0.0)))
    assert 0 < kept["long_rays"] < 0.8 * fresh["long_rays"]
    kept, *_ = after(first, with_material(first, 0, kd=0.3))
    assert kept["long_rays"] == 0


# --- Ends -------------------------------------------------------------------------------------------------

def test_what_was_cancelled_leaves_what_was_done(still_life):
    """In the midst of nodes: what is known stays right, what was begun is begun again."""
    scene = still_life.with_settings(samples=4, filter_size=1.5)
    fresh = render_image(scene, PASSES)
    ready = None
    for most in (1, 2, 5, 9):
        ready = prepare(scene, PASSES, previous=ready)
        trace, calls, over = ready.soft._trace, itertools.count(1), threading.Event()

        def tracing(nodes, todo, check, trace=trace, calls=calls, over=over, most=most):
            if next(calls) > most:
                over.set()  # after these nodes were claimed, before they are known
            return trace(nodes, todo, check)

        ready.soft._trace = tracing
        with pytest.raises(Cancelled):
            draw(ready, Framebuffer.create(scene, PASSES), cancelled=over.is_set, tile_size=8)
        assert ready.soft.store._broken
    assert 0 < ready.soft.store.known.any(1).sum() < fresh.statistics["nodes"]
    kept, _ = drawn(scene, ready)
    assert 0 < kept.statistics["long_rays"] < fresh.statistics["long_rays"]
    for name in PASSES:
        np.testing.assert_array_equal(kept.passes[name], fresh.passes[name])


def test_sameness_is_of_contents():
    camera = Camera.look_at((0, -7, 5), (0, 0, 0), 40, WIDTH, WIDTH)
    assert same(camera, Camera.look_at((0, -7, 5), (0, 0, 0), 40, WIDTH, WIDTH))
    assert not same(camera, Camera.look_at((0, -7, 5.001), (0, 0, 0), 40, WIDTH, WIDTH))
    assert not same(camera, Object("camera")) and isinstance(camera, Camera)
