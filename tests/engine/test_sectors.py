"""What records know of each direction, for surfaces that reflect some more than others (sectors.h)."""

import numpy as np
import pytest
from light_meshes import Camera, Material, Scene, Settings, Shape, box, rectangle
from light_meshes.gathered.directions import nested
from light_meshes.gathered.records import RAYS, Lobe
from light_meshes.picture.render import Prepared, render_image

WHITE, BLACK = Material("white", Od=(0.5, 0.5, 0.5)), Material("black", Od=(0, 0, 0))
PLASTIC = Material("plastic", Od=(0.3, 0.1, 0.1), highlight="GGX", blurred=True, dielectric=1.0, layered=1.0,
                   roughness=0.4)
POINT = np.array([-0.3, 0.0, 0.0])


def test_each_sector_has_rays():
    for _, n in RAYS:
        rays = nested(n)
        for some in (rays.first, *rays.all.values()):
            assert np.bincount(some.within, minlength=64).min() >= 1


def beside_a_wall(wall=True, material=PLASTIC, **values):
    """A floor in a white world, which a high black wall hides on the side of +x."""
    shapes = [Shape(rectangle((-40, -40), (0.5, 40)), material, "floor")]
    if wall:
        shapes.append(Shape(box((0.5, -40, -1), (0.6, 40, 60)), BLACK, "wall"))
    chosen = Settings(**({"mode": "WHITTED", "world_light": "SKY", "bounces": 1, "h": 0.02} | values))
    return Scene.from_shapes(shapes, Camera.look_at((-1, -3, 2), (-0.3, 0, 0), 30, 24, 16), [], chosen,
                             world_color=(1.0, 1.0, 1.0))


def lobe_of(way, alpha):
    """The share of a lobe that goes to −x, by summing it up direction by direction."""
    theta, phi = np.meshgrid((np.arange(400) + 0.5) / 400 * np.pi / 2, (np.arange(800) + 0.5) / 800 * 2 * np.pi)
    L = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    h = L - way
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    facets = 1 / (h[..., 2]**2 * (alpha**2 - 1) + 1)**2
    left = L[..., 2] / (L[..., 2] + np.sqrt(alpha**2 + (1 - alpha**2) * L[..., 2]**2))
    fresnel = 0.04 + 0.96 * (1 - np.abs((h * L).sum(-1)))**5
    weight = facets * left * fresnel * np.sin(theta)
    return weight[L[..., 0] < 0].sum() / weight.sum()


@pytest.mark.parametrize("alpha", [0.09, 0.16, 0.36])
def test_a_lobe_sees_the_side_to_which_it_goes(alpha):
    """Half of the sky is hidden: the share of the lobe that goes to the other half, to .08, as sectors are wide."""
    ready = Prepared(beside_a_wall())
    angles = np.radians([20, 40, 60])
    around = np.radians([0, 45, 90, 135, 180])
    way = np.array([(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), -np.cos(t)) for t in angles for p in around])
    met, hits = ready.world.closest("camera", POINT - 0.3 * way, way)
    assert len(met) == len(way) and np.allclose(hits.P, POINT, atol=1e-6)
    everywhere = ready.lighting.everywhere
    found = everywhere(hits, lambda: None, Lobe(way, np.full(len(way), alpha))).light
    true = np.array([lobe_of(one, alpha) for one in way])
    assert np.abs(found[:, 0] - true).max() < 0.08 and np.abs(found[:, 0] - true).mean() < 0.03
    assert true.min() < 0.3 and true.max() > 0.7


def test_in_a_white_world_a_lobe_is_white():
    ready = Prepared(beside_a_wall(wall=False))
    way = np.array([(0.0, np.sin(t), -np.cos(t)) for t in np.radians([0, 30, 60, 80])])
    _, hits = ready.world.closest("camera", POINT - 0.3 * way, way)
    found = ready.lighting.everywhere(hits, lambda: None, Lobe(way, np.full(4, 0.16))).light
    np.testing.assert_allclose(found, 1.0, atol=1 / 512)


def test_it_depends_on_neither_tiles_nor_threads():
    scene = beside_a_wall(samples=4)
    one = render_image(scene, threads=1).passes["Combined"]
    np.testing.assert_array_equal(one, render_image(scene, threads=2, tile_size=8).passes["Combined"])


def test_nothing_is_kept_where_nothing_shines():
    """A scene without such surfaces pays no memory for it."""
    records = Prepared(beside_a_wall(material=WHITE)).lighting.everywhere
    assert records._sectors.shape[1] == 0
