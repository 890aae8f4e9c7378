"""Hundreds of lamps that count together from far away (Light Threshold): the bound holds, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from light_meshes.rays.geometry import Hits
from light_meshes.scene.material import Material
from light_meshes.shadows import grouped
from light_meshes.shadows.grouped import tree
from light_meshes.surface import clusters, colours, shading
from scenes import point, with_lights
from sized_lamps import scene_of

KINDS = (
    Material("matt", Od=(0.5, 0.3, 0.7)),
    Material("metal", Od=(0, 0, 0), highlight="GGX", roughness=0.4, metal=1.0, F0=(0.9, 0.6, 0.2), F82=(0.8, 1, 1)),
    Material("plastic", Od=(0.2, 0.2, 0.2), highlight="GGX", roughness=0.3, dielectric=1.0, layered=1.0),
    Material("coat", Od=(0.6, 0.1, 0.1), highlight="GGX", roughness=0.8, dielectric=1.0, coat=1.0, coat_roughness=0.2),
    Material("cloth", Od=(0.4, 0.4, 0.4), highlight="GGX", sheen=0.8, diffuse_roughness=0.6),
    Material("phong", ks=0.5, nShiny=30.0),
    Material("matt, older bumps", Od=(0.5, 0.3, 0.7), facet_bumps=False),
    Material("coat, older formulas", Od=(0.6, 0.1, 0.1), highlight="GGX", roughness=0.8, dielectric=1.0, coat=1.0,
             coat_roughness=0.6, coat_several=False, facet_bumps=False),
)


def lamps(seed, count=300):
    """Small lamps of several colours in three clouds over a floor."""
    random = np.random.default_rng(seed)
    middle = random.uniform((-3, -3, 1), (3, 3, 3), (3, 3))
    places = middle[random.integers(0, 3, count)] + random.normal(0, 0.4, (count, 3)) * (1, 1, 0.3)
    softness = "SIZE", "SCENE"
    return [replace(point(at, 1.0, f"lamp {n}", radius=0.02, softness=softness[n % 2], facing_disc=n % 4 == 0),
                    intensity=tuple(random.uniform(0.01, 0.1, 3).tolist())) for n, at in enumerate(places.tolist())]


class Setup:
    """What `grouped.tree` wants of a shadow method's setup: all lamps have the same casters."""

    class casters:  # noqa: N801
        whole, soft, sharp = (), (), ()

    def __init__(self, lights):
        self.lights, self.targets = lights, shading.light_arrays(lights).targets()


def receivers(random, n, bent):
    """n places on a bumpy floor, seen from above, with one of KINDS each."""
    def unit(v):
        return np.ascontiguousarray(v / np.linalg.norm(v, axis=1)[:, None])

    P = random.uniform((-4, -4, -0.1), (4, 4, 0.1), (n, 3))
    Ng = unit(random.normal((0, 0, 1), 0.3, (n, 3)))
    smooth = unit(Ng + random.normal(0, 0.1, (n, 3)))
    Ns = unit(smooth + random.normal(0, 0.2, (n, 3))) if bent else smooth
    way = unit(random.normal(0, 1, (n, 3)))
    way *= -np.sign((way * Ng).sum(1))[:, None]
    kind = random.integers(0, len(KINDS), n).astype(np.int32)
    table = shading.material_arrays(KINDS)
    hits = Hits(P, Ng, Ns, np.zeros((n, 2), np.float32), kind, np.zeros(n, np.int32), np.ones(n, np.bool_), kind, table,
                smooth if bent else None)
    return hits, np.ascontiguousarray(way), table.Od[kind]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0.001, 0.01, 0.2]))
def test_light_without_shadows_is_within_the_bound(seed, bent, threshold):
    random = np.random.default_rng(seed)
    lights = tuple(lamps(seed))
    arrays = shading.light_arrays(lights)
    hits, way, Od = receivers(random, 70, bent)
    lit = shading.Lit(arrays, hits.table, hits, way, Od)
    asked = clusters.Clusters(arrays, *tree(Setup(lights)))(lit, hits.Ng, np.full(70, threshold))
    active, exact, found = np.empty_like(asked.active), np.zeros((70, 3)), np.zeros((70, 3))
    shading.reaching(lit, False, active)
    bits = np.unpackbits(active.view(np.uint8), axis=1, count=len(lights), bitorder="little")
    shading.gather(lit, np.ascontiguousarray(bits[..., None], np.float32), exact)
    terms = np.zeros((70, 3)), np.zeros((70, 3))
    asked.groups.gather(np.ones((70, len(lights), 1), np.float32), found, *terms)
    assert np.isfinite(found).all() and np.allclose(terms[0] + terms[1], found)
    assert (np.abs(found - exact) <= asked.wrong[:, None] * (1 + 1e-5) + 1e-5 * exact.max()).all()
    assert (asked.wrong <= asked.bound).all() and np.allclose(found.max(1), asked.total, rtol=0.5, atol=1e-6)
    if threshold == 0.2:
        assert len(asked.groups.lamp) < 0.7 * bits.sum()
    for p, (a, b) in enumerate(zip(asked.groups.start[:-1], asked.groups.start[1:], strict=True)):
        of = asked.groups.lamp[a:b]
        assert sorted(of) == np.flatnonzero(np.unpackbits(asked.active[p].view(np.uint8), bitorder="little")).tolist()


def crowded(**values):
    return with_lights(scene_of("boxes", "sphere", 40, h=0.1, **values), *lamps(5))


def direct(scene):
    """What the camera sees of the lamps, lamp by lamp or in groups, and the groups' bound."""
    ready = Prepared(scene)
    direction, hits = ready.world.coarse_view()
    sums = ready.lighting.direct(hits, direction, lambda: None)
    if ready.lighting._clusters is None:
        return sums.colour, None, ready
    lit = ready.lighting._surfaces(hits, direction, colours.matt(hits, ready.world.textures))
    return sums.colour, ready.lighting._clusters(
        lit, hits.Ng, np.full(len(hits.P), scene.settings.light_threshold)).bound, ready


@pytest.mark.parametrize("threshold", [0.005, 0.1])
def test_the_light_with_shadows_is_within_the_bound(threshold):
    exact, none, _ = direct(crowded())
    found, bound, ready = direct(crowded(light_threshold=threshold))
    assert none is None and bound is not None
    error = np.abs(found - exact).max(1)
    assert error.max() > 0 and (error <= bound * (1 + 1e-5) + 1e-6).all()
    assert error.mean() < 0.2 * bound.mean()  # as a rule far below it
    assert ready.stats.counts["grouped_receivers"] == len(exact) * grouped.PARTS


def test_tiles_and_threads_change_nothing():
    a, b = (render_image(crowded(light_threshold=0.05), threads=n, tile_size=size) for n, size in ((1, 64), (2, 8)))
    assert np.array_equal(a.passes["Combined"], b.passes["Combined"])
    assert a.statistics["light_bound"] > 0


def test_what_rough_mirrors_show_does_not_depend_on_tiles_either():
    """There receivers are put in an order by their places."""
    metal = Material("metal", Od=(0, 0, 0), kd=0.0, highlight="GGX", roughness=0.7, metal=1.0, blurred=True)
    scene = replace(crowded(light_threshold=0.05, mode="WHITTED"), materials=(metal,))
    a, b = (render_image(scene, threads=n, tile_size=size) for n, size in ((1, 64), (2, 8)))
    assert a.statistics["secondary_rays"] > 0
    assert np.array_equal(a.passes["Combined"], b.passes["Combined"])
    assert a.statistics["light_bound"] == b.statistics["light_bound"]


@pytest.mark.parametrize("why", ["few", "links", "spots"])
def test_lamps_count_one_by_one_where_groups_do_not_do(why):
    scene = crowded(light_threshold=0.05)
    if why == "few":
        scene = with_lights(scene, *scene.lights[:clusters.MANY - 1])
    elif why == "links":
        scene = with_lights(scene, *(replace(light, receivers=(0,)) for light in scene.lights))
    else:
        scene = with_lights(scene, *(replace(light, type="SPOT") for light in scene.lights))
    assert Prepared(scene).lighting._clusters is None
