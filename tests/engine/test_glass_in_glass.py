"""Which body of glass counts at a point: bubbles, holes, overlapping bodies, and cameras inside them."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Mesh, Scene, Shape, box, rectangle, rotate_x, sphere, translate
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Material
from scenes import GREY, look_down, point, settings


def glass(ior=1.5, t=0.9, **more):
    return Material("glass", Od=(0, 0, 0), ka=0.0, kd=0.0, kt=(t, t, t), ior=ior, **more)


def turned_round(mesh):
    back = [0, 2, 1]
    return Mesh(mesh.vertices, mesh.triangles[:, back], None if mesh.normals is None else -mesh.normals[:, back])


def joined(a, b):
    normals = None if a.normals is None else np.concatenate([a.normals, b.normals])
    return Mesh(np.concatenate([a.vertices, b.vertices]),
                np.concatenate([a.triangles, b.triangles + len(a.vertices)]), normals)


def checks():
    """A floor of glowing squares."""
    for i, j in np.ndindex(8, 8):
        lamp = Material(f"lamp {i} {j}", kd=0.0, ka=0.0, emission=(float(i + 1), float(j + 1), 1.0 + (i + j) % 2))
        yield Shape(rectangle((i - 4, j - 4), (i - 3, j - 3), 0.0), lamp, f"square {i} {j}")


VIEWS = [Camera.look_at((3, -4, 5), (0, 0, 1), 30, 32, 32), look_down(0.05, 0.02, 3, 32)]


def seen(parts, camera, **values):
    """The picture of parts above a glowing floor."""
    scene = Scene.from_shapes([*checks(), *parts], camera, [], settings(mode="WHITTED", refraction="VIEW", **values),
                              world_color=(0.5, 0.5, 0.5))
    return render_image(scene).passes["Combined"][..., :3]


X = np.random.default_rng(3).uniform(-1.5, 1.5, (200, 3)) * [1, 1, 0]


def lit(parts, **values):
    """S of a light on a floor below parts."""
    values = {"refraction": "FULL", "shadows": "SHARP", "h": 0.03, "kI": 1.5} | values
    scene = Scene.from_shapes([Shape(rectangle((-9, -9), (9, 9), 0.0), GREY, "floor"), *parts], look_down(0, 0, 1, 4),
                              [point((0.7, -0.4, 4.0))], settings(**values))
    return Prepared(scene).light_visibility(X, np.repeat([[0.0, 0, 1]], len(X), 0)).reshape(len(X), -1)


PLACE = translate(0, 0, 1) @ rotate_x(0.3)
OUTER = {"block": box((-0.8, -0.7, -0.6), (0.8, 0.7, 0.6)), "ball": sphere(0.8, 32, 16)}
INNER = {"block": box((-0.45, -0.3, -0.35), (0.25, 0.4, 0.3)), "ball": sphere(0.4, 24, 12)}


@pytest.mark.parametrize("shape", OUTER)
@pytest.mark.parametrize("fresnel", [False, True])
def test_a_bubble_is_a_hole_in_the_glass(shape, fresnel):
    """Index 1 and a higher priority, in other words air: as faces turned inwards, in the same mesh or in another."""
    material = glass(fresnel=fresnel)
    air = Shape(INNER[shape], glass(1.0, priority=1, fresnel=fresnel), "air", [PLACE])
    solid = Shape(OUTER[shape], material, "glass", [PLACE])
    hole = Shape(joined(OUTER[shape], turned_round(INNER[shape])), material, "glass", [PLACE])
    other = Shape(turned_round(INNER[shape]), material, "hole", [PLACE])
    for camera in VIEWS:
        pictures = [seen(parts, camera) for parts in ([hole], [solid, other], [solid, air], [solid])]
        np.testing.assert_array_equal(pictures[1], pictures[0])
        np.testing.assert_array_equal(pictures[2], pictures[0])
        assert (np.abs(pictures[3] - pictures[0]).max(2) > 0.1).mean() > 0.05
    if fresnel:
        return  # shadow paths know none
    S = [lit(parts) for parts in ([hole], [solid, other], [solid, air], [solid])]
    for other in S[1:3]:  # a facet's own path may be found from the beams of one and not of the other
        assert (np.abs(other - S[0]) > 1e-6).mean() <= 0.01
    assert (np.abs(S[3] - S[0]) > 0.1).mean() > 0.02


def test_air_in_water_in_glass():
    """Three spheres, one in the other, by priority; the same as shells that do not overlap."""
    radii, index = (0.8, 0.7, 0.3), (1.5, 1.33, 1.0)
    nested = [Shape(sphere(r, 32, 16), glass(n, t=1.0, priority=i), f"{i}", [translate(0, 0, 1)])
              for i, (r, n) in enumerate(zip(radii, index, strict=True))]
    hole = joined(sphere(radii[1], 32, 16), turned_round(sphere(radii[2], 32, 16)))
    shells = [Shape(joined(sphere(radii[0], 32, 16), turned_round(sphere(0.5, 32, 16))), glass(1.5, t=1.0), "glass",
                    [translate(0, 0, 1)]), Shape(hole, glass(1.33, t=1.0, priority=1), "water", [translate(0, 0, 1)])]
    for camera in VIEWS:
        np.testing.assert_array_equal(seen(nested, camera), seen(shells, camera))
    np.testing.assert_allclose(lit(nested), lit(shells), rtol=1e-6)


def test_a_transparent_bsdf_is_no_medium():
    """Index 1 without a priority of its own, inside glass or before it: light goes on in what it was in."""
    solid = Shape(OUTER["ball"], glass(1.5, t=1.0), "glass", [PLACE])
    clear = Shape(INNER["ball"], glass(1.0, t=1.0), "clear", [PLACE])
    tinted = Shape(INNER["ball"], glass(1.0, t=0.7), "tinted", [PLACE])
    for camera in VIEWS:
        np.testing.assert_array_equal(seen([solid, clear], camera), seen([solid], camera))
        whole, less = seen([solid], camera), seen([solid, tinted], camera)
        np.testing.assert_allclose((less - whole) * (less - 0.49 * whole) * (less - 0.49**2 * whole), 0, atol=1e-5)
        assert (less < 0.6 * whole).mean() > 0.05
    np.testing.assert_allclose(lit([solid, clear]), lit([solid]), rtol=1e-6)


def test_air_beside_glass_changes_nothing():
    """A body of index 1 outside of all glass is not there, whatever its priority."""
    solid = Shape(OUTER["ball"], glass(), "glass", [PLACE])
    air = Shape(sphere(0.3), glass(1.0, t=1.0, priority=3), "air", [translate(0.4, -0.9, 2.2)])
    for camera in VIEWS:
        np.testing.assert_array_equal(seen([solid, air], camera), seen([solid], camera))
    np.testing.assert_allclose(lit([solid, air]), lit([solid]), rtol=1e-6)


@pytest.mark.parametrize("order", [1, -1])
def test_of_equal_priorities_the_smaller_body_is_there(order):
    """For the camera from either side, and for the light: as if it had the higher priority."""
    large, small = box((-0.8, -0.8, 0.2), (0.6, 0.8, 1.0)), box((-0.5, -0.6, 0.4), (0.9, 0.6, 1.4))

    def both(priority):
        return [Shape(large, glass(1.5), "large"), Shape(small, glass(1.2, 0.8, priority=priority), "small")][::order]

    for camera in (*VIEWS, Camera.look_at((-3, 2, 3), (0, 0, 1), 30, 32, 32)):
        np.testing.assert_array_equal(seen(both(0), camera), seen(both(1), camera))
    np.testing.assert_array_equal(lit(both(0)), lit(both(1)))


def test_glass_in_glass_of_its_index_reflects_nothing():
    """Where the index does not change there is no surface to reflect, as in Cycles; not the two of a thin sheet."""
    white = glass(1.5, t=1.0, fresnel=True)
    solid, inner = Shape(OUTER["ball"], white, "glass", [PLACE]), glass(1.5, t=1.0, fresnel=True, priority=1)
    for camera in VIEWS:
        np.testing.assert_array_equal(seen([solid, Shape(INNER["ball"], inner, "same", [PLACE])], camera),
                                      seen([solid], camera))


@pytest.mark.parametrize("ortho", [False, True])
def test_a_camera_inside_glass_begins_in_it(ortho):
    """In a block in a block, over one lamp: what each pixel sees follows from Snell's law. In part, too."""
    index, floor = (1.5, 1.3), 0.0
    parts = [Shape(box((-3, -3, 0.5), (3, 3, 2.5)), glass(index[0], 1.0), "outer"),
             Shape(box((-2, -2, 1.0), (2, 2, 2.0)), glass(index[1], 1.0, priority=1), "inner")]
    matrix = translate(0.1, 0.2, 1.6) @ rotate_x(0.2)
    camera = look_down(0, 0, 1.0, 24) if ortho else Camera.look_at((0, 0, 9), (0, 0, 0), 30, 24, 24)
    camera = replace(camera, matrix=matrix, clip_start=0.01)
    picture = seen(parts, camera)
    x0, x1, y0, y1 = camera.window
    u, v = np.meshgrid(x0 + (x1 - x0) * (np.arange(24) + 0.5) / 24, y0 + (y1 - y0) * (np.arange(24) + 0.5) / 24)
    zero = np.zeros_like(u)
    P = np.stack([u, v, zero] if ortho else [zero, zero, zero], -1) @ matrix[:3, :3].T + matrix[:3, 3]
    D = np.stack([zero, zero, zero - 1] if ortho else [u, v, zero - 1], -1) @ matrix[:3, :3].T
    D /= np.linalg.norm(D, axis=-1, keepdims=True)
    for n1, n2, z in ((index[1], index[0], 1.0), (index[0], 1.0, 0.5), (1.0, 1.0, floor)):
        P = P + ((z - P[..., 2]) / D[..., 2])[..., None] * D
        D = D * (n1 / n2)
        D[..., 2] = -np.sqrt(1 - D[..., 0]**2 - D[..., 1]**2)
    at = np.floor(P + 4).astype(int)
    sure = (np.abs(P[..., :2] - np.rint(P[..., :2])) > 1e-3).all(-1) & (np.abs(P[..., :2]) < 4).all(-1)
    assert sure.mean() > 0.9
    np.testing.assert_allclose(picture[sure], np.stack([at[..., 0] + 1, at[..., 1] + 1, 1 + at[..., :2].sum(-1) % 2],
                                                       -1)[sure], rtol=1e-5)


def test_the_bodies_around_a_point():
    """Twelve spheres, one in the other, a hole in one of them, and two that overlap: by distance alone."""
    parts = [Shape(sphere(1 - 0.07 * i, 64, 32), glass(1.6 - 0.04 * i, priority=i), f"{i}") for i in range(12)]
    parts.append(Shape(joined(sphere(0.9, 32, 16), turned_round(sphere(0.5, 32, 16))), glass(priority=20), "shell",
                       [translate(3, 0, 0)]))
    parts.append(Shape(sphere(0.6, 32, 16), glass(1.2), "beside", [translate(4, 0, 0), translate(4.5, 0, 0)]))
    interfaces = Prepared(Scene.from_shapes(parts, look_down(0, 0, 1, 4), [], settings(refraction="VIEW"))).glass
    points = np.random.default_rng(5).uniform((-1, -1, -1), (5, 1, 1), (3000, 3))
    away = [np.linalg.norm(points - c, axis=1) for c in ((0, 0, 0), (3, 0, 0), (4, 0, 0), (4.5, 0, 0))]
    edges = [(away[0], 1 - 0.07 * i) for i in range(12)] + [(away[1], 0.9), (away[1], 0.5)] + [(away[2], 0.6),
                                                                                              (away[3], 0.6)]
    sure = np.all([(d < 0.98 * r) | (d > r) for d, r in edges], 0)
    inside = np.stack([d < r for d, r in edges])
    expected = inside[:12].sum(0) + (inside[12] & ~inside[13]) + inside[14] + inside[15]
    for rows in (np.flatnonzero(sure), *np.flatnonzero(sure)[:50, None]):
        found = interfaces.around(points[rows])
        np.testing.assert_array_equal((found >= 0).sum(1), expected[rows])


def black_shares(parts, camera):
    """Of the pixels, how many are black where nothing but total reflection, which is not followed, takes light."""
    scene = Scene.from_shapes(parts, camera, [], settings(mode="WHITTED", refraction="VIEW", max_depth=0),
                              world_color=(1.0, 1.0, 1.0))
    return (render_image(scene).passes["Combined"][..., 0] < 0.5).mean()


def averaged(mesh):
    """A mesh with the normals that Blender gives it: at each vertex the mean of its facets'."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    facet = np.cross(b - a, c - a)
    normals = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(normals, mesh.triangles[:, k], facet / np.linalg.norm(facet, axis=1, keepdims=True))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(mesh, normals=normals[mesh.triangles])


@pytest.mark.parametrize(("rings", "normals"), [(12, lambda mesh: mesh), (24, averaged), (48, averaged)])
def test_what_enters_a_ball_leaves_it(rings, normals):
    """As in a true ball: no ray reflects totally at a facet of the rim, and shows there what is elsewhere (specks)."""
    ball = Shape(normals(sphere(1.0, 2 * rings, rings)), glass(1.5, t=1.0), "ball", [rotate_x(0.4)])
    for camera in (look_down(0, 0, 2.1, 200), Camera.look_at((3, -4, 5), (0, 0, 0), 18, 200, 200)):
        assert black_shares([ball], camera) == 0


def test_round_surfaces_still_reflect_totally():
    """A bubble is dark beyond the critical angle, where b > R/n."""
    block = Shape(box((-1, -1, -1), (1, 1, 1)), glass(1.5, t=1.0), "glass")
    shining = Material("lamp", kd=0.0, ka=0.0, emission=(1.0,) * 3)
    lamp = Shape(box((-0.9, -0.9, -0.9), (0.9, 0.9, 0.9)), shining, "lamp")
    bubble = Shape(sphere(0.6, 64, 32), glass(1.0, t=1.0, priority=1), "air")
    expected = np.pi * 0.6**2 * (1 - 1 / 1.5**2) / 1.6**2
    camera = look_down(0, 0, 1.6, 200, height=0.8)
    assert black_shares([block, lamp, bubble], camera) == pytest.approx(expected, rel=0.02)
