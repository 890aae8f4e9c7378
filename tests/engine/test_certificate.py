"""The certificate skips short rays without changing a bit, whatever stands near or almost near."""

from dataclasses import replace

import numpy as np
import pytest
from kept import after, moved, with_light, with_object
from light_meshes import Camera, Mesh, Scene, Shape, box, cylinder, rectangle, sphere
from light_meshes.picture.plan import forced
from light_meshes.picture.render import prepare, render_image
from light_meshes.rays.tracer import points
from light_meshes.shadows.meshes import averaging
from light_meshes.shadows.meshes.certificate import MARGIN
from light_meshes.shadows.meshes.lattice import candidates
from light_meshes.support import processors
from scenes import GREY, four_lights, point, random_scene, settings, sun, tabletop
from test_metamorphic import turned

LIGHTS = [point((1.5, -1.0, 3.0)), point((-2.0, 0.5, 2.5), name="b"), sun((0.3, 0.4, -1.0))]


def inside_out(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.triangles[:, ::-1])


def cut(mesh: Mesh, times: int) -> Mesh:
    """Each triangle in four, `times` times; corners in common stay so."""
    for _ in range(times):
        v, t = mesh.vertices, mesh.triangles
        ends = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), 1)
        edges, row = np.unique(ends, axis=0, return_inverse=True)
        ab, bc, ca = (len(v) + row.reshape(3, -1))
        a, b, c = t.T
        mesh = Mesh(np.concatenate([v, v[edges].mean(1)]), np.concatenate(
            [np.stack(k, 1) for k in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]))
    return mesh


def stairs() -> Mesh:
    """Concave, closed: boxes of which each stands on the one before, as one mesh."""
    steps = [box((-0.8, -0.8 + 0.3 * n, 0.2 * n), (0.8, 0.8, 0.2 * n + 0.2)) for n in range(4)]
    return Mesh(np.concatenate([s.vertices for s in steps]),
                np.concatenate([s.triangles + 8 * n for n, s in enumerate(steps)]))


def bowl() -> Mesh:
    """The lower half of a ball, seen from inside: hollow."""
    ball = sphere(1.0, 48, 24)
    low = ball.vertices[ball.triangles][..., 2].max(1) <= 1e-9
    return Mesh(ball.vertices, ball.triangles[low])


SHAPES = {
    "ball": sphere(0.8, 64, 32), "coarse ball": sphere(0.8, 8, 5), "box": box((-0.7, -0.6, -0.5), (0.7, 0.6, 0.5)),
    "cut box": cut(box((-0.7, -0.6, -0.5), (0.7, 0.6, 0.5)), 4), "room": box((-3, -3, -2), (3, 6, 4)),
    "room inside out": inside_out(box((-3, -3, -2), (3, 6, 4))), "stairs": stairs(), "bowl": bowl(),
    "cylinder": cylinder(0.6, -0.7, 0.7, 40), "sheet": rectangle((-1, -1), (1, 1), 0.1),
    "cut sheet": cut(rectangle((-1, -1), (1, 1), 0.1), 5),
}


def scene_of(mesh: Mesh, seed: int | None, **values):
    """A shape above a floor and beside a small box, all turned by `seed`."""
    T = np.eye(4) if seed is None else turned(seed)
    parts = [Shape(mesh, GREY, "shape", [T]), Shape(rectangle((-4, -4), (4, 4), -0.9), GREY, "floor", [T]),
             Shape(box((0.9, -0.3, -0.9), (1.1, 0.1, -0.4)), GREY, "near", [T])]
    camera = Camera.look_at((0.6, -2.6, 1.9), (0, 0, 0), 60, 64, 48)
    return Scene.from_shapes(parts, replace(camera, matrix=T @ camera.matrix),
                             [replace(light, position=tuple(T[:3, :3] @ light.position),
                                      direction=tuple(T[:3, :3] @ light.direction)) for light in LIGHTS],
                             settings(**({"h": 0.04, "samples": 2} | values)))


def both(scene):
    """Pictures and figures with the certificate and without, whose bits are the same."""
    with forced(certificate=True):
        on = render_image(scene)
    with forced(certificate=False):
        off = render_image(scene)
    np.testing.assert_array_equal(on.passes["Combined"], off.passes["Combined"])
    assert off.statistics["spared_rays"] == 0
    return on.statistics, off.statistics


@pytest.mark.parametrize("seed", [None, 1, 2])
@pytest.mark.parametrize("shape", SHAPES)
def test_no_bit_changes_and_rays_are_spared(shape, seed):
    on, off = both(scene_of(SHAPES[shape], seed))
    assert on["short_rays"] < off["short_rays"] and on["long_rays"] == off["long_rays"]
    assert on["empty_sets"] == off["empty_sets"] and on["uniform_skips"] == off["uniform_skips"]


@pytest.mark.parametrize("values", [
    {"weights": "SMOOTH"}, {"uniform_skip": False}, {"kI": 3.0}, {"h": 0.3}, {"h": 0.003},
    {"weights": "SMOOTH", "uniform_skip": False, "kI": 1.0}], ids=str)
def test_whatever_is_set(values):
    for shape in ("ball", "room inside out", "stairs"):
        on, off = both(scene_of(SHAPES[shape], 3, **values))
        assert on["short_rays"] < off["short_rays"] or values.get("h") == 0.3


@pytest.mark.parametrize("seed", range(12))
def test_random_scenes(seed):
    both(replace(random_scene(seed, (0.02, 0.05, 0.1)[seed % 3], 2.0, 5), camera=replace(
        random_scene(seed, 0.1, 2.0, 1).camera, width=60, height=60)))


@pytest.mark.parametrize("radii", [(0.05, 0.2, 0.1), (0.02, 0.0, 0.3)])
def test_lights_with_radii_of_their_own(radii):
    scene = scene_of(SHAPES["ball"], None)
    lights = tuple(replace(light, softness="RADIUS", soft_radius=r)
                   for light, r in zip(scene.lights, radii, strict=True))
    on, off = both(replace(scene, lights=lights))
    assert on["short_rays"] < off["short_rays"]


@pytest.mark.parametrize("seed", [None, 1, 2])
@pytest.mark.parametrize("shape", ["ball", "coarse ball", "smooth cylinder"])
def test_receivers_above_their_facets_have_one_too(shape, seed, monkeypatch):
    scene, kept = scene_of({**SHAPES, "smooth cylinder": cylinder(0.6, -0.7, 0.7, 9, smooth=True)}[shape], seed), []

    def counted(*given, free_start=averaging.free_start):
        free_start(*given)
        kept.append(given[-1].sum())

    monkeypatch.setattr(averaging, "free_start", counted)
    objects = tuple(replace(o, shadow_terminator_geometry_offset=0.5) for o in scene.objects)
    on, off = both(replace(scene, objects=objects))
    assert sum(kept) > 20 and on["short_rays"] < off["short_rays"]


@pytest.mark.parametrize("glass", ["BOUNDED", "PAPER"])
@pytest.mark.parametrize("refraction", ["NONE", "FULL"])
def test_beside_glass(glass, refraction):
    scene = scene_of(SHAPES["ball"], None, glass=glass, refraction=refraction, h=0.08)
    clear = replace(GREY, name="glass", alpha=1.0, kt=(0.8, 0.6, 0.9), ior=1.5, transparent_shadow=True)
    materials = scene.geometry.triangle_materials.copy()
    materials[-12:] = len(scene.materials)
    on, off = both(replace(scene, materials=(*scene.materials, clear),
                           geometry=replace(scene.geometry, triangle_materials=materials)))
    assert on["short_rays"] < off["short_rays"]


def test_what_casts_no_shadow_is_not_in_the_way():
    scene = scene_of(SHAPES["sheet"], None)
    ghost = replace(scene.objects[2], visible_shadow=False)
    both(replace(scene, objects=(*scene.objects[:2], ghost)))


@pytest.mark.parametrize("shape", SHAPES)
def test_embree_blocks_no_ray_that_is_spared(shape):
    """All candidates of the receivers with a certificate, whether a picture would ask for them or not."""
    for seed in (None, 4, 5, 6):
        with forced(certificate=True):
            ready = prepare(scene_of(SHAPES[shape], seed), ("Combined",))
        _, hits = ready.world.coarse_view()
        holds = ready.shadowing.certificate.holds(hits.P, hits.Ng, hits.triangle)
        P, N, lattice = hits.P[holds], hits.Ng[holds], ready.soft.lattice
        start, candidate, _, position, _ = candidates(lattice, P, N)
        row = np.repeat(np.arange(len(P), dtype=np.int32), start[:, -1] - start[:, 0])
        above = ((position[candidate] - P[row]) * N[row]).sum(1) > MARGIN * ready.tracer.scale
        assert above.mean() > 0.9 or not len(above)
        assert not ready.tracer.occluded(P, row[above], points(position), candidate[above], N, closed=True).any()
        assert holds.mean() > 0.1 or shape == "bowl"


def test_a_small_picture_of_many_triangles_goes_without():
    scene = tabletop(16)
    assert render_image(scene).statistics["plan"]["certificate"].startswith("off")
    assert render_image(scene).statistics["spared_rays"] == 0
    assert render_image(four_lights(96)).statistics["plan"]["certificate"].startswith("on")



def test_the_certificate_stays_while_the_casters_and_r_do():
    scene = scene_of(SHAPES["ball"], None)
    with forced(certificate=True):
        _, _, first, moved_light = after(scene, with_light(scene, 0, position=(1.0, 1.0, 3.0)))
        assert first.shadowing.certificate is moved_light.shadowing.certificate is not None
        for other in (replace(scene, settings=replace(scene.settings, kI=2.5)), moved(scene, 2, (0.1, 0.0, 0.0)),
                      with_object(scene, 2, visible_shadow=False)):
            _, _, first, then = after(scene, other)
            assert first.shadowing.certificate is not then.shadowing.certificate


def test_it_does_not_depend_on_threads():
    """Convex instances and planes, of several objects each, are found by threads that share them out."""
    names = ("ball", "stairs", "cut sheet", "room", "cut box", "bowl", "coarse ball")
    shapes = [Shape(SHAPES[name], GREY, f"{name} {n}") for n in range(2) for name in names]
    camera = Camera.look_at((3, -4, 3), (0, 0, 0), 60, 64, 64)
    scene = Scene.from_shapes(shapes, camera, LIGHTS, settings(h=0.04, samples=4))
    found = []
    for threads in (1, 2, 5):
        processors.tell(threads)
        try:
            with forced(certificate=True):
                found.append(prepare(scene, ("Combined",)).shadowing.certificate)
        finally:
            processors.tell(None)
    assert len(np.unique(found[0].body)) > 10
    for other in found[1:]:
        for name in ("body", "clear", "keys", "cell"):
            assert np.array_equal(getattr(found[0], name), getattr(other, name)), name
        assert np.array_equal(found[0].only[other.keys >= 0], other.only[other.keys >= 0])
        assert all(np.array_equal(a, b) for a, b in zip(found[0].convex, other.convex, strict=True))


def test_without_lamps_there_is_none():
    ready = prepare(replace(tabletop(64, shadows="LIGHT_MESHES", samples=16), lights=()), ("Combined",))
    assert ready.shadowing.certificate is None and "certificate" not in ready.stats.seconds
