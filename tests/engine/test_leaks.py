"""There is no light where none can come: S2 (Fig. 2), a thin wall (H1), a plate just above a floor and coplanar faces
(H5).
"""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from light_meshes import Scene, Shape, box, rectangle
from light_meshes.picture.render import Prepared, render_image
from oracle import Lattice, Oracle
from scenes import GREY, WHITE, light_leak, look_down, low_plate, point, settings, wall, with_lights

UP = np.array([0.0, 0.0, 1.0])


def test_a_light_behind_the_surface_adds_nothing_though_a_node_sees_it():
    """Fig. 2: P on the plate's top; the node beside the plate's edge is lit by the second light from below."""
    node, P = np.array([-0.05, 0.0, 1.08]), np.array([0.05, 0.0, 1.0])
    scene = light_leak(h=0.1, kI=3.0, lattice_rotation=False, lattice_origin=tuple(node))
    prepared = Prepared(scene)
    oracle = Oracle(scene, Lattice(prepared.soft.lattice.position))
    assert oracle.visible(node[None], scene.lights[1])[0][0]
    start, nodes = prepared.soft.interpolation_set(P[None], UP[None])
    assert (0, 0, 0) in set(map(tuple, nodes[start[0]:start[1]].tolist()))
    np.testing.assert_array_equal(prepared.light_visibility(P[None], UP[None])[0], [1, 0])


def test_on_the_whole_plate_the_second_light_adds_nothing():
    both = light_leak()
    one = with_lights(both, both.lights[0])
    plate = render_image(both, passes=("Combined", "Depth", "Normal"))
    alone = render_image(one).passes["Combined"]
    top = (plate.passes["Normal"][..., 2] == 1) & (np.abs(_height(both, plate.passes["Depth"][..., 0]) - 1) < 1e-3)
    assert top.sum() > 1000
    assert (plate.passes["Combined"] != alone).any()  # the second light does something elsewhere
    np.testing.assert_array_equal(plate.passes["Combined"][top], alone[top])


@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
def test_xi_goes_by_the_face_and_not_by_the_shading_normal(shadows):
    """Smooth shading may lean towards the light below: Ω(2) is then not 0, but ξ(2) is."""
    both = light_leak(shadows=shadows)
    leaning = both.geometry.corner_normals.copy()
    t0, nt = both.geometry.meshes[0, 2:]
    leaning[t0:t0 + nt][leaning[t0:t0 + nt, :, 2] == 1] = np.array((-0.8, 0, 0.6))
    both = replace(both, geometry=replace(both.geometry, corner_normals=leaning))
    result = render_image(both, passes=("Combined", "Depth", "Normal"))
    alone = render_image(with_lights(both, both.lights[0])).passes["Combined"]
    top = np.abs(_height(both, result.passes["Depth"][..., 0]) - 1) < 1e-3
    top &= np.abs(result.passes["Normal"][..., 2] - 0.6) < 1e-3
    toward = np.array(both.lights[1].position) - (0.05, 0, 1)
    assert toward @ (-0.8, 0, 0.6) > 0 and top.sum() > 1000
    np.testing.assert_array_equal(result.passes["Combined"][top], alone[top])


def _height(scene, depth):
    """z of what is seen in every pixel."""
    c = scene.camera
    left, right, bottom, top = c.window
    u = left + (right - left) * (np.arange(c.width) + 0.5) / c.width
    v = bottom + (top - bottom) * (np.arange(c.height) + 0.5) / c.height
    return c.matrix[2, 3] + depth * (c.matrix[2, 0] * u[None] + c.matrix[2, 1] * v[:, None] - c.matrix[2, 2])


def test_behind_the_post_the_shadows_edge_is_half_shadow():
    """Q lies just inside the post's sharp shadow of the low light, so V(2,Q) = 0, yet 0 < S < 1."""
    scene = light_leak(h=0.03, kI=3.0)
    light = np.array(scene.lights[1].position)
    corner = np.array([scenes.S2_POST[0][0], scenes.S2_POST[1][1]])  # of the post's lit face
    edge = corner - light[:2]  # the shadow's side is the upright plane through the light and this corner
    outward = np.array([-edge[1], edge[0]]) / np.linalg.norm(edge)
    Q = np.append(light[:2] + 1.3 * edge - 0.02 * outward, 0.0)
    sharp = Prepared(scene.with_settings(shadows="SHARP")).light_visibility(Q[None], UP[None])[0]
    soft = Prepared(scene).light_visibility(Q[None], UP[None])[0]
    assert sharp[1] == 0
    assert 0.2 < soft[1] < 0.5


def test_a_wall_thinner_than_h_keeps_all_light_on_its_side():
    """H1: left exactly 1, right exactly 0, on the wall's faces and on the floor beside it."""
    scene = wall()
    prepared = Prepared(scene)
    random = np.random.default_rng(0)
    y, z, far = random.uniform(-0.9, 0.9, 500), random.uniform(0.02, 2, 500), random.uniform(0.0101, 0.9, 500)
    for side, expected in ((-1, 1.0), (1, 0.0)):
        x = np.full(500, side * np.float32(0.01).astype(float))
        face = prepared.light_visibility(np.stack([x, y, z], 1), np.tile([side, 0.0, 0.0], (500, 1)))
        floor = prepared.light_visibility(np.stack([side * far, y, 0 * y], 1), np.tile(UP, (500, 1)))
        assert (face == expected).all()
        assert (floor == expected).all()


@pytest.mark.parametrize("rotated", [True, False])
def test_deep_under_a_low_plate_it_is_dark(rotated):
    """H5: between plate and floor there is room for few nodes or none: dark either way, as RRTA."""
    scene = low_plate(lattice_rotation=rotated)
    random = np.random.default_rng(1)
    P = np.c_[random.uniform(-0.65, 0.65, (800, 2)), np.zeros(800)]
    prepared = Prepared(scene)
    assert (prepared.light_visibility(P, np.tile(UP, (800, 1))) == 0).all()
    if not rotated:  # nodes lie at z = 0, which is on the floor, and at z = h, which is above the plate
        start, _ = prepared.soft.interpolation_set(P, np.tile(UP, (800, 1)))
        assert (np.diff(start) == 0).all()


def test_the_low_plate_shows_no_speckle():
    """On the plate's top all is lit, exactly."""
    scene = low_plate()
    P = np.c_[np.random.default_rng(2).uniform(-0.99, 0.99, (2000, 2)), np.full(2000, np.float32(0.04))]
    assert (Prepared(scene).light_visibility(P, np.tile(UP, (2000, 1))) == 1).all()


@pytest.mark.parametrize("rotated", [True, False])
def test_a_box_that_ends_in_the_floors_plane_neither_leaks_nor_speckles(rotated):
    """H5: the box's bottom and the floor are the same plane; the box is lit from above."""
    parts = [Shape(rectangle((-3, -3), (3, 3), 0.0), WHITE, "floor"),
             Shape(box((-0.5, -0.5, 0), (0.5, 0.5, 1)), GREY, "box")]
    scene = Scene.from_shapes(parts, look_down(0, 0, 3, 120), [point((0.05, 0.02, 2.5))],
                              settings(h=0.1, lattice_rotation=rotated))
    S = render_image(scene, passes=("Shadow",)).passes["Shadow"][..., 0]
    x = (np.arange(120) + 0.5) / 40 - 1.5
    x, y = np.meshgrid(x, x)
    reach = np.maximum(np.abs(x), np.abs(y))
    assert (S[reach < 0.49] == 1).all()  # the box's top
    assert (S[reach > 0.87 + 0.3 + 0.03] == 1).all()  # floor: beyond the shadow (up to .87) and its penumbra
    near = (reach > 0.5) & (reach < 0.57)  # the floor at the box's foot lies in its shadow, 3h wide or more
    assert near.any() and (S[near] < 0.9).all()
