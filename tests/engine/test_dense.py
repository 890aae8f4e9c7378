"""Light from everywhere on dense meshes: as on coarse ones, at about their cost."""

import numpy as np
import pytest
from light_meshes import Light, Material, Mesh, Shape, box, sphere, translate
from light_meshes.gathered import cards, thinned
from light_meshes.picture.render import render_image
from test_everywhere import BLACK, WHITE, close, scene, seen


def sheet(low, high, parts):
    """A plane at height 0 of many small triangles."""
    x, y = (np.linspace(a, b, parts + 1) for a, b in zip(low, high, strict=True))
    vertices = np.stack([*np.meshgrid(x, y), np.zeros((parts + 1,) * 2)], -1).reshape(-1, 3)
    at = (np.arange(parts)[:, None] * (parts + 1) + np.arange(parts)).ravel()
    a, b, c, d = at, at + 1, at + parts + 2, at + parts + 1
    return Mesh(vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def test_a_ball_on_a_dense_plane():
    ball = Shape(sphere(0.5, 64, 32), BLACK, matrices=[translate(0, 0, 0.5)])
    P, light = seen(scene([ball, Shape(sheet((-2, -2), (2, 2), 300), WHITE)], (0, -3, 1.0), (0, -0.4, 0.1), 100,
                          auto_h=False, h=0.04), lambda x, y, z: (np.abs(z) < 1e-6) & (np.hypot(x, y) < 1.5) & (
                              np.hypot(x, y) > 0.15))
    d = np.linalg.norm(P - (0, 0, 0.5), axis=1)
    close(light, 1 - 0.5**2 / d**2 * (0.5 / d))


def test_light_does_not_go_below_a_wall_on_a_dense_floor():
    """Two rooms on one dense floor, with a wall .02 thick between; one has a lamp."""
    grey = Material("grey", Od=(0.8, 0.8, 0.8))
    walls = [box((-2, -2, 2), (2, 2, 2.1)), box((-2.1, -2, -0.1), (-2, 2, 2)), box((2, -2, -0.1), (2.1, 2, 2)),
             box((-2, -2.1, -0.1), (2, -2, 2)), box((-2, 2, -0.1), (2, 2.1, 2)), box((-0.01, -2, -0.1), (0.01, 2, 2))]
    shapes = [*(Shape(m, grey) for m in walls), Shape(sheet((-2, -2), (2, 2), 200), grey)]
    lamp = Light("lamp", "POINT", (1.0, 1.0, 1.0), (-1.0, 0.0, 1.5))
    bright, leaked = (render_image(scene(shapes, (side, -1.9, 1.5), (side * 0.3, 1, 0), 30, [lamp], (0, 0, 0),
                                         bounces=2, shadows="SHARP", auto_h=False, h=0.05)).passes["Combined"][..., 0]
                      for side in (-1, 1))
    assert bright.mean() > 0.1
    assert leaked.max() < 1e-3 * bright.mean()


@pytest.mark.parametrize("smooth", [True, False])
def test_few_corners_of_a_dense_ball_gather_for_all(monkeypatch, smooth):
    """Nearly the same light as if each did, with far fewer rays."""
    grey, red = Material("grey", Od=(0.7, 0.7, 0.7)), Material("red", Od=(0.7, 0.2, 0.2))
    walls = [Shape(box((-2, -2, -0.1), (2, 2, 0)), grey), Shape(box((-2, 1.5, 0), (2, 1.6, 3)), grey)]
    ball = Shape(sphere(0.8, 400, 200, smooth=smooth), red, matrices=[translate(0.3, 0.4, 0.8)])
    lamp = Light("lamp", "POINT", (8.0, 8.0, 8.0), (-1.0, -1.0, 2.5))
    of = scene([*walls, ball], (0, -2.5, 1.3), (0.3, 0.3, 0.8), 60, [lamp], (0.1, 0.1, 0.1), bounces=1, shadows="SHARP",
               auto_h=False, h=0.06)
    light, rays = [], []
    for small in (0.0, thinned.SMALL):
        monkeypatch.setattr(thinned, "SMALL", small)
        result = render_image(of, ("Combined", "Diffuse Indirect", "Position"))
        on_ball = np.linalg.norm(result.passes["Position"] - (0.3, 0.4, 0.8), axis=-1) < 0.81
        light.append(result.passes["Diffuse Indirect"][on_ball][:, 0])
        rays.append(result.statistics["gathered_rays"])
    error = np.abs(light[1] - light[0]) / light[0].mean()
    assert 0 < np.median(error) < 0.01
    assert np.percentile(error, 95) < 0.05
    assert rays[1] < 0.6 * rays[0]


def crown(n, size, seed=5):
    """Cards of two triangles, turned at random, in a ball of radius 1 around the origin."""
    rng = np.random.default_rng(seed)
    middle = rng.normal(size=(n, 3))
    middle *= (rng.uniform(0, 1, (n, 1)) ** (1 / 3)) / np.linalg.norm(middle, axis=1, keepdims=True)
    turn = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0] * size / 2
    corners = middle[:, None] + np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) @ turn[:, :2]
    first = 4 * np.arange(n)[:, None]
    return Mesh(corners.reshape(-1, 3), np.concatenate([first + np.array([(0, 1, 2)]), first + np.array([(0, 2, 3)])]))


def both_ways(monkeypatch, of):
    """The light from everywhere, places and statistics, without cards and with them."""
    found = []
    for largest in (0.0, cards.CARD):
        monkeypatch.setattr(cards, "CARD", largest)
        done = render_image(of, ("Combined", "Diffuse Indirect", "Position"))
        found.append((done.passes["Diffuse Indirect"][..., 0], done.passes["Position"], done.statistics))
    return found


def test_leaves_gather_at_their_corners_only(monkeypatch):
    """Nearly the same light as with records at all corners and between them, with far fewer rays."""
    leaf, grey = Material("leaf", Od=(0.3, 0.6, 0.2), alpha=0.7), Material("grey", Od=(0.7, 0.7, 0.7))
    shapes = [Shape(crown(300, 0.25), leaf, matrices=[translate(0, 0, 1.4)]), Shape(sheet((-3, -3), (3, 3), 4), grey)]
    sun = Light("sun", "SUN", (2.0, 2.0, 2.0), direction=(0.4, 0.3, -0.8))
    of = scene(shapes, (0, -4, 1.8), (0, 0, 1.2), 48, [sun], (0.5, 0.6, 0.8), bounces=1, shadows="SHARP", auto_h=False,
               h=0.1)
    (slow, P, before), (fast, _, after) = both_ways(monkeypatch, of)
    leaves, floor = (P[..., 2] > 0.3), (np.abs(P[..., 2]) < 1e-3) & (np.abs(P[..., 0]) > 1.5)
    assert leaves.sum() > 400 and floor.sum() > 200
    error = np.abs(fast - slow)[leaves] / slow[leaves].mean()
    mean, rays = fast[leaves].mean() / slow[leaves].mean(), after["gathered_rays"] / before["gathered_rays"]
    middle, most = np.percentile(error, (50, 95))
    print(f"leaves: median {middle:.3f}, 95 % {most:.3f}, mean {mean:.3f}, rays {rays:.2f}")
    assert 0 < middle < 0.04 and most < 0.2
    assert abs(mean - 1) < 0.02 and rays < 0.4
    np.testing.assert_array_equal(fast[floor], slow[floor])


def test_a_large_sheet_with_cut_outs_is_no_card(monkeypatch):
    """Its triangles are as small as leaves, but they hang together."""
    veil = Material("veil", Od=(0.5, 0.5, 0.5), alpha=0.9)
    of = scene([Shape(sheet((-2, -2), (2, 2), 20), veil), Shape(box((0.2, 0.2, 0), (0.6, 0.6, 0.5)), WHITE)],
               (0, -3, 2), (0, 0, 0), 40, bounces=1, auto_h=False, h=0.1)
    (slow, *_), (fast, *_) = both_ways(monkeypatch, of)
    np.testing.assert_array_equal(fast, slow)
