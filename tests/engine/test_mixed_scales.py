"""Small things beside huge or far ones: near things keep their shadows, down to a millimetre (see `frame`)."""

from dataclasses import replace

import numpy as np
import pytest
from hard_cases import glass
from hypothesis import given
from hypothesis import strategies as st
from light_meshes import Camera, Scene, Shape, box, rectangle, scale, sphere, translate
from light_meshes.glass.media import closed
from light_meshes.picture.render import Prepared, measure, render_image
from light_meshes.rays.camera import camera_rays
from light_meshes.rays.frame import FAR, cut
from light_meshes.rays.geometry import flatten
from light_meshes.scene.description import Material
from scenes import GREY, WHITE, hall, point, settings

MIRROR = Material("mirror", Od=(0, 0, 0), ka=0.0, kd=0.0, mirror=(1.0, 1.0, 1.0))
UNSEEN = {"visible_camera": False, "visible_reflection": False, "visible_shadow": False}


def tilted(angle):
    matrix = np.eye(4)
    matrix[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    return matrix


def table(kind, ground=3.0, tilt=0.3, *more):
    """Plates 1 and 10 mm above a ground, and a book of 5 mm on it, seen from 1.7 m; all turned by `tilt`."""
    T = tilted(tilt)
    parts = [Shape(rectangle((-ground, -ground), (ground, ground), 0.0), WHITE, "ground", [T]),
             Shape(box((-0.3, -0.3, 0.001), (0.1, 0.1, 0.002)), GREY, "plate", [T]),
             Shape(box((0.2, -0.2, 0.01), (0.5, 0.4, 0.011)), GREY, "higher", [T]),
             Shape(box((-0.6, 0.2, 0.0), (-0.3, 0.5, 0.005)), GREY, "book", [T])]
    eye, target = (0.1, -1.4, 1.0), (0, 0, 0)
    if kind == "refracted":
        parts.append(Shape(sphere(0.12, 12, 6), glass(), "ball", [T @ translate(0.3, -0.55, 0.13)]))
    if kind == "mirror":
        parts.append(Shape(rectangle((-2, -2), (2, 2), 2.0), MIRROR, "mirror", [T]))
        eye, target = (0.1, -1.0, 0.6), (0, -0.5, 2.0)
    turn = T[:3, :3]
    width = 40 if kind == "refracted" else 100
    camera = Camera.look_at(turn @ eye, turn @ target, 45, width, width)
    return Scene.from_shapes([*parts, *more], camera, [point(turn @ (1.2, -0.7, 0.35), 3.0)], settings(
        mode="WHITTED", shadows="LIGHT_MESHES" if kind in ("soft", "refracted") else "SHARP", h=0.01, kI=2.0,
        refraction="FULL"))


def stray(distance, **visible):
    way = np.array([0.7, 0.5, -0.4]) * distance
    return Shape(box((-1, -1, -1), (1, 1, 1)), GREY, "stray", [translate(*way)], visible)


def dome(radius, **visible):
    return Shape(sphere(radius, 16, 8), WHITE, "dome", flags=visible)


FAR_OR_HUGE = {
    **{f"stray {d:g}": (3.0, stray(d)) for d in (1e3, 1e6, 1e9)},
    **{f"ground {r:g}": (r,) for r in (1e2, 1e3, 1e4, 1e5, 1e6)},
    **{f"dome {r:g}": (3.0, dome(r)) for r in (1e2, 1e4, 1e6)},
    "dome without shadow": (3.0, dome(2e4, visible_shadow=False)),
    "dome in mirrors only": (3.0, dome(2e4, visible_camera=False, visible_shadow=False)),
    "ground, dome and stray": (1e6, dome(1e6), stray(1e9)),
    "thin and long": (3.0, Shape(box((-1, -1, -1), (1, 1, -0.9)), GREY, "thin", [
        translate(0, 0, -1e9) @ scale(1e10, 1e10, 1e10)])),
}


def shadows(scene):
    """Where the picture is lit, (n,) of each pixel with a surface, and the picture."""
    colour = render_image(scene).passes["Combined"][..., 0].astype(float)
    return colour > 0.02 * colour.max(), colour


@pytest.mark.parametrize(("kind", "what"), [(k, w) for k in ("sharp", "soft", "mirror") for w in FAR_OR_HUGE]
                         + [("refracted", w) for w in ("ground 10000", "ground, dome and stray")])
def test_what_is_near_keeps_its_shadows(kind, what):
    lit, alone = shadows(table(kind))
    with_it, together = shadows(table(kind, FAR_OR_HUGE[what][0], 0.3, *FAR_OR_HUGE[what][1:]))
    surface = render_image(table(kind), ("Depth",)).passes["Depth"][..., 0] < 1e9  # else the far thing is in view
    assert (~lit & surface).sum() > (20 if kind == "refracted" else 200)
    assert (lit == with_it)[surface].mean() > 0.999
    assert (~with_it & ~lit & surface).sum() >= 0.99 * (~lit & surface).sum()
    assert (np.abs(together - alone)[surface] > 0.02 * alone.max()).mean() < 0.005


@pytest.mark.parametrize("distance", [1e4, 1e9])
def test_what_nothing_sees_changes_no_bit(distance):
    scene = table("soft")
    unseen = table("soft", 3.0, 0.3, stray(distance, **UNSEEN))
    np.testing.assert_array_equal(render_image(unseen).passes["Combined"], render_image(scene).passes["Combined"])
    assert flatten(unseen)[0].reach == 1


def test_what_is_beyond_all_digits_is_named():
    result = render_image(table("sharp", 3.0, 0.3, stray(1e30)))
    assert [w for w in result.warnings if "'stray'" in w and "mistyped location" in w]
    np.testing.assert_array_equal(result.passes["Combined"] > 0, render_image(table("sharp")).passes["Combined"] > 0)


def test_ordinary_scenes_have_their_box_as_frame():
    for scene in (table("sharp"), hall(4)):
        surfaces, _ = flatten(scene)
        assert surfaces.reach == 1 and not len(surfaces.piece) and np.abs(surfaces.vertices).max() <= 1


def test_far_things_are_right_at_their_own_distance():
    """Boxes on a ground of 1,000 km, each four times as far and as large as the last: they all look alike."""
    boxes = [Shape(box((-0.1, -0.1, 0), (0.1, 0.1, 0.2)), GREY, f"box {k}", [
        translate(0, 3 * 4.0**k, 0) @ scale(*[3 * 4.0**k] * 3)]) for k in range(9)]
    lit = []
    for k in range(9):
        d = 3 * 4.0**k
        ground = Shape(rectangle((-1e6, -1e6), (1e6, 1e6), 0.0), WHITE, "ground")
        screw = Shape(box((-1, -1, -1), (1, 1, 1)), GREY, "screw",
                      [translate(0, 0.01, -0.003) @ scale(1e-3, 1e-3, 1e-3)])
        camera = Camera.look_at((0, 0, d / 2), (0, d, 0), 40, 60, 60)
        scene = Scene.from_shapes([ground, boxes[k], screw], camera, [point((d, d / 2, d / 2), d * d)],
                                  settings(shadows="SHARP"))
        lit.append(render_image(scene).passes["Combined"][..., 0])
    assert 50 < (lit[0] == 0).sum() < 2000
    for other in lit[1:]:
        assert (np.abs(other - lit[0]) > 0.01 * lit[0].max()).sum() <= 4


@pytest.mark.parametrize("moved", [0.0, 0.4, 30.0])
def test_a_view_that_moves_gets_the_frame_that_suits_it(moved):
    scene = table("soft", 1e5)
    eye = scene.camera.matrix.copy()
    eye[:3, 3] += tilted(0.3)[:3, :3] @ (moved, 0, 0)
    camera = replace(scene.camera, matrix=eye)
    before = Prepared(scene)
    kept, fresh = Prepared(scene, previous=before, camera=camera), Prepared(scene, camera=camera)
    for name in ("centre", "scale", "vertices", "triangles"):
        np.testing.assert_array_equal(getattr(kept.surfaces, name), getattr(fresh.surfaces, name))
    assert (kept.surfaces is before.surfaces) == (moved < 30)


# --- Cutting ----------------------------------------------------------------------------------------------

lengths = st.floats(-8, 8).map(lambda x: np.sign(x) * 10 ** abs(x) if abs(x) > 1 else x)


@given(st.lists(lengths, min_size=9, max_size=9))
def test_pieces_are_the_triangle(numbers):
    corners = np.array(numbers).reshape(1, 3, 3)
    pieces, uv, source = cut(corners)
    a, e, f = corners[0, 0], corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0]
    size = np.abs(corners).max() + 1
    np.testing.assert_allclose(pieces, a + uv[..., :1] * e + uv[..., 1:] * f, atol=1e-12 * size)
    first, second = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    turn = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    assert (turn > 0).all() and abs(turn.sum() - 1) < 1e-9 and not source.any()
    for k in range(3):  # near the centre all edges are short, elsewhere as short as the centre is far
        p, q = pieces[:, k], pieces[:, (k + 1) % 3]
        square = ((q - p) ** 2).sum(1)
        along = np.clip(-(p * (q - p)).sum(1) / np.maximum(square, 1e-300), 0, 1)
        near = ((p + along[:, None] * (q - p)) ** 2).sum(1)
        assert (square <= np.maximum(1, near) * (1 + 1e-9)).all()


def test_pieces_of_neighbours_fit():
    """A huge ball and a huge box stay closed."""
    ball = Shape(sphere(3e5, 9, 5), glass(), "ball", [translate(0, 0, -2.9e5)])
    slab = Shape(box((-1e6, -2e6, -1), (3e6, 1e6, -0.5)), glass(0.8), "slab", [tilted(0.2)])
    surfaces, _ = flatten(table("sharp", 3.0, 0.3, ball, slab))
    glassy = np.isin(surfaces.instance, (4, 5))
    assert len(surfaces.piece) and (surfaces.piece[glassy] >= 0).sum() > 200
    assert closed(surfaces, glassy)[glassy].all()
    assert (np.diff(surfaces.instance) >= 0).all() and np.abs(surfaces.vertices).max() < FAR


def test_texture_coordinates_and_normals_go_on_over_pieces():
    scene = table("sharp", 1e5)
    g = scene.geometry
    random = np.random.default_rng(0)
    normals = random.normal(size=g.corner_normals.shape) * 0.1 + (0, 0, 1)
    uvs = (g.vertices[g.triangles][..., :2]).astype(np.float32)  # of the mesh that comes first: in its own plane
    scene = replace(scene, geometry=replace(g, corner_normals=normals.astype(np.float32), uvs=uvs))
    ready = Prepared(scene)
    assert (ready.surfaces.piece >= 0).sum() > 100
    origin, direction, _ = camera_rays(scene.camera, (0, 0, 100, 100), np.zeros((1, 2)))
    _, hits = ready.closest("camera", origin, direction)
    ground = ready.surfaces.instance[hits.triangle] == 0
    local = hits.P[ground] @ tilted(0.3)[:3, :3]
    np.testing.assert_allclose(hits.uv[ground], local[:, :2], atol=1e-2)  # float32 of 1e5


@pytest.mark.parametrize("what", ["dome 100", "dome 10000", "dome without shadow", "stray 1e+09", "thin and long"])
def test_a_backdrop_does_not_set_the_step(what):
    """Most of the picture is dome, behind a table seen from low."""
    scenes = [table("soft"), table("soft", FAR_OR_HUGE[what][0], 0.3, *FAR_OR_HUGE[what][1:])]
    turn = tilted(0.3)[:3, :3]
    camera = Camera.look_at(turn @ (0.1, -1.4, 1.0), turn @ (0, 1, 1.05), 45, 64, 64)
    steps = [measure(replace(s, camera=camera))["h"] for s in scenes]
    assert steps[0] < 0.05 and steps[1] == pytest.approx(steps[0], rel=0.05)
