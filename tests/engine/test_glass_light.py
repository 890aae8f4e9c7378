"""The amount of light that comes through glass: through many panes, at flat faces, and at total reflection."""

import numpy as np
import pytest
from light_meshes import Mesh, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.glass import beams
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Material
from refraction_reference import rotation
from scenes import GREY, look_down, point, settings, sun
from visible import visibility


def glass(t=1.0, ior=1.5, **more):
    return Material("glass", Od=(0, 0, 0), ka=0.0, kd=0.0, kt=(t, t, t), ior=ior, **more)


def on_the_floor(parts, light, P, **values):
    """S of a light on a floor below parts, and the scene made ready."""
    floor = Shape(rectangle((-9, -9), (9, 9), 0.0), GREY, "floor")
    values = {"refraction": "FULL", "shadows": "SHARP", "h": 0.03, "kI": 1.5} | values
    ready = Prepared(Scene.from_shapes([floor, *parts], look_down(0, 0, 1, 4), [light], settings(**values)))
    return visibility(ready, P, np.repeat([[0.0, 0, 1]], len(P), 0)).reshape(len(P), -1)[:, 0], ready


def panes(count, t):
    return [Shape(box((-2, -2, 0.1 + 0.05 * i), (2, 2, 0.11 + 0.05 * i)), glass(t), f"pane {i}") for i in range(count)]


SPOTS = np.c_[np.random.default_rng(0).uniform(-0.3, 0.3, (20, 2)), np.zeros(20)]


@pytest.mark.parametrize("light", [point((0.2, 0.1, 8.0)), sun((0.1, 0.2, -1))], ids=["point", "sun"])
@pytest.mark.parametrize("values", [{}, {"shadows": "LIGHT_MESHES"}, {"caustics": "FOCUS"}], ids=str)
def test_light_comes_through_any_number_of_panes(light, values):
    for count in (5, 12) if not values else (5,):
        S, ready = on_the_floor(panes(count, 0.9), light, SPOTS, **values)
        tolerance = 0.1 if "caustics" in values else 1e-6  # the way through is longer than the straight one
        np.testing.assert_allclose(S, 0.9 ** (2 * count), rtol=tolerance)
        assert ready.shadowing.path_warnings() == []


def test_behind_more_glass_than_is_followed_light_goes_straight(monkeypatch):
    monkeypatch.setattr(beams, "DEEPER", 0)
    S, ready = on_the_floor(panes(6, 0.9), point((0.2, 0.1, 8.0)), SPOTS)
    np.testing.assert_allclose(S, 0.9**12, rtol=1e-6)
    (sentence,) = ready.shadowing.path_warnings()
    assert "followed through 8 bends only" in sentence
    shade = Shape(rectangle((-2, -2), (2, 2), 5.0), GREY, "shade")  # but not through what is opaque
    np.testing.assert_array_equal(on_the_floor([*panes(6, 0.9), shade], point((0.2, 0.1, 8.0)), SPOTS)[0], 0)


def cut_box(half, cuts):
    """A box around 0, each face cut into cuts × cuts squares."""
    quads, corners = [], {}
    for axis in range(3):
        for side in (-1, 1):
            for i, j in np.ndindex(cuts, cuts):
                square = []
                for a, b in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))[::side]:
                    p = np.empty(3)
                    p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3] = side, 2 * a / cuts - 1, 2 * b / cuts - 1
                    square.append(corners.setdefault(tuple(np.round(p * half, 9)), len(corners)))
                quads.append(square)
    quads = np.array(quads)
    return Mesh(np.array(list(corners)), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def refracted(D, N, eta):
    """Directions behind a surface whose normal N is against D, and where there are any."""
    cosine = -(D * N).sum(1)
    square = 1 - eta**2 * (1 - cosine**2)
    return eta * D + (eta * cosine - np.sqrt(np.maximum(square, 0)))[:, None] * N, square > 0


def photons(light, half, matrix, n, inside, count=10**6, reflections=12):
    """What a light of 1 W/sr sends through a box onto `inside` of the floor, by the number of total reflections."""
    N = np.concatenate([matrix[:3, :3].T, -matrix[:3, :3].T])
    d = np.tile(half, 2) + N @ matrix[:3, 3]
    way = matrix[:3, 3] - light
    distance = np.linalg.norm(way)
    way, edge = way / distance, np.sqrt(1 - (half @ half) / distance**2)
    random = np.random.default_rng(1)
    cosine, angle = 1 - random.random(count) * (1 - edge), 2 * np.pi * random.random(count)
    side = np.cross(way, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side)
    around = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(way, side)
    D = cosine[:, None] * way + np.sqrt(1 - cosine**2)[:, None] * around
    slope = D @ N.T
    t = (d - light @ N.T) / slope
    enters, first = np.where(slope < 0, t, -np.inf).max(1), np.where(slope < 0, t, -np.inf).argmax(1)
    meets = enters < np.where(slope > 0, t, np.inf).min(1)
    P, D, first = (light + enters[:, None] * D)[meets], D[meets], first[meets]
    D, _ = refracted(D, N[first], 1 / n)
    landed = []
    for _ in range(reflections):
        slope = D @ N.T
        t = np.where(slope > 1e-12, (d - P @ N.T) / np.where(slope > 1e-12, slope, 1), np.inf)
        wall = t.argmin(1)
        P = P + t.min(1)[:, None] * D
        out, leaves = refracted(D, -N[wall], n)
        Q, out = P[leaves], out[leaves]
        Q, out = Q[out[:, 2] < 0], out[out[:, 2] < 0]
        landed.append(inside(Q - (Q[:, 2] / out[:, 2])[:, None] * out).sum() * 2 * np.pi * (1 - edge) / count)
        P, D, N0 = P[~leaves], D[~leaves], N[wall[~leaves]]
        D = D - 2 * (D * N0).sum(1)[:, None] * N0
    return np.array(landed)


@pytest.mark.parametrize(("seed", "half", "n"), [(0, (0.5, 0.5, 0.5), 1.5), (1, (0.9, 0.6, 0.15), 1.33),
                                                 (7, (0.9, 0.6, 0.15), 1.5), (2, (0.3, 0.3, 0.8), 1.8)])
def test_a_tilted_block_sends_on_what_photons_bring(seed, half, n):
    """FOCUS, over the whole floor, with what total reflection turns: up to half of the light. Faces may be cut."""
    half, matrix, size, cells = np.array(half), rotation(seed), 3.5, 120
    random = np.random.default_rng(seed)
    light = np.array([*random.uniform(-1.5, 1.5, 2), random.uniform(2.5, 4)])
    matrix[:3, 3] = 0, 0, 1
    expected = photons(light, half, matrix, n, lambda P: (abs(P[:, :2]) < size).all(1))
    x = (np.arange(cells) + 0.5) / cells * 2 * size - size
    P = np.stack([*np.meshgrid(x, x), np.zeros((cells, cells))], -1).reshape(-1, 3)
    way = light - P
    on_a_cell = way[:, 2] / (way**2).sum(1) ** 1.5 * (2 * size / cells) ** 2

    def arrives(t, cuts, caustics="FOCUS"):
        block = Shape(cut_box(half, cuts), glass(t, n), "block", [matrix])
        return on_the_floor([block], point(light), P, h=0.002, caustics=caustics)[0] @ on_a_cell

    shadow = arrives(0.0, 1)
    whole, cut = arrives(1.0, 1) - shadow, arrives(1.0, 8) - shadow
    print(f"of {expected.sum():.4f}, {expected[1:].sum():.4f} by total reflection: {whole / expected.sum():.1%}")
    assert whole == pytest.approx(expected.sum(), rel=0.02) and whole == pytest.approx(cut, rel=0.005)


@pytest.mark.parametrize("count", [1, 5, 20])
def test_the_camera_sees_through_any_number_of_panes_and_a_mirror_behind_them(count):
    """With the default max_depth, which bounds mirrors only: t² for each pane, and again on the way back."""
    mirror = Material("mirror", Od=(0, 0, 0), kd=0.0, ka=0.0, mirror=(1.0,) * 3)
    halves = [Shape(rectangle((-9, -9), (0, 9), 0.0), mirror, "mirror"),
              Shape(rectangle((0, -9), (9, 9), 0.0), Material("lamp", kd=0.0, ka=0.0, emission=(3.0,) * 3), "lamp")]
    scene = Scene.from_shapes([*halves, *panes(count, 0.97)], look_down(0, 0, 3, 8), [],
                              settings(mode="WHITTED", refraction="VIEW"), world_color=(1.0,) * 3)
    picture = render_image(scene).passes["Combined"][..., 0]
    np.testing.assert_allclose(picture[:, 5:], 3 * 0.97 ** (2 * count), rtol=1e-5)
    np.testing.assert_allclose(picture[:, :3], 0.97 ** (4 * count), rtol=1e-5)


def test_the_camera_sees_through_glass_in_glass():
    """Twelve spheres of falling index, one in the other, and three in a row: white before a white world."""
    nested = [Shape(sphere(1 - 0.07 * i, 32, 16), glass(1.0, 1.6 - 0.04 * i, priority=i), f"{i}",
                    [translate(0, 0, 1.5)]) for i in range(12)]
    row = [Shape(sphere(0.5, 32, 16), glass(1.0), f"ball {i}", [translate(0, 0, 0.5 + 1.1 * i)]) for i in range(3)]
    for parts in (nested, row):
        scene = Scene.from_shapes(parts, look_down(0, 0, 3, 24), [], settings(mode="WHITTED", refraction="VIEW"),
                                  world_color=(1.0,) * 3)
        np.testing.assert_allclose(render_image(scene).passes["Combined"][..., 0], 1, rtol=1e-5)
