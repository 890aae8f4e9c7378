"""Algorithm Ψ agrees with the simple oracle: the same sets, the same light. Receivers of which the oracle is unsure are
skipped.
"""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from light_meshes.picture.render import Prepared, render_image
from oracle import Lattice, Oracle
from scenes import random_scene

SCENES = {"seed": st.integers(0, 2**31 - 1), "h": st.floats(0.15, 0.3), "kI": st.floats(0.5, 4.0),
          "lights": st.integers(1, 9), "rotated": st.booleans()}


def compared(scene, receivers, seed):
    prepared = Prepared(scene)
    oracle = Oracle(scene, Lattice(prepared.soft.lattice.position))
    return prepared, oracle, *oracle.receivers(receivers, seed)


@given(**SCENES)
def test_interpolation_sets_are_the_oracles(seed, h, kI, lights, rotated):
    scene = random_scene(seed, h, kI, lights, lattice_rotation=rotated)
    prepared, oracle, P, N = compared(scene, 25, seed)
    start, nodes = prepared.soft.interpolation_set(P, N)
    answers = [oracle.interpolation_set(p, n) for p, n in zip(P, N, strict=True)]
    for k, (expected, sure) in enumerate(answers):
        if sure:
            assert set(map(tuple, nodes[start[k]:start[k + 1]].tolist())) == set(map(tuple, expected.tolist()))
    assume(sum(sure for _, sure in answers) > len(P) / 3)  # or the example says little


@given(**SCENES, skip=st.booleans())
def test_soft_visibility_is_the_oracles(seed, h, kI, lights, rotated, skip):
    scene = random_scene(seed, h, kI, lights, lattice_rotation=rotated, uniform_skip=skip)
    prepared, oracle, P, N = compared(scene, 25, seed)
    S = prepared.light_visibility(P, N)
    answers = [oracle.soft(p, n) for p, n in zip(P, N, strict=True)]
    for k, (expected, sure) in enumerate(answers):
        if sure:
            np.testing.assert_allclose(S[k], expected, rtol=0, atol=1e-6)
    assume(sum(sure for _, sure in answers) > len(P) / 4)


@given(seed=st.integers(0, 2**31 - 1), lights=st.integers(1, 9))
def test_sharp_visibility_is_the_oracles(seed, lights):
    scene = random_scene(seed, 0.2, 2.0, lights, shadows="SHARP")
    oracle = Oracle(scene)
    P, N = oracle.receivers(100, seed)
    S = Prepared(scene).light_visibility(P, N)
    answers = [oracle.sharp(p, n) for p, n in zip(P, N, strict=True)]
    for k, (expected, sure) in enumerate(answers):
        if sure:
            np.testing.assert_array_equal(S[k], expected)
    assume(sum(sure for _, sure in answers) > len(P) / 2)


@hypothesis_settings(max_examples=5)
@given(seed=st.integers(0, 2**31 - 1), shadows=st.sampled_from(["SHARP", "LIGHT_MESHES"]))
def test_pixels_are_the_oracles(seed, shadows):
    """The whole way through: camera, normals, every type of light, Phong's highlight, ambient light."""
    scene = random_scene(seed, 0.2, 1.8, 4, shadows=shadows)
    oracle = Oracle(scene, Lattice(Prepared(scene.with_settings(shadows="LIGHT_MESHES")).soft.lattice.position))
    expected, sure = oracle.picture()
    found = render_image(scene).passes["Combined"][..., :3]
    np.testing.assert_allclose(found[sure], expected[sure], rtol=1e-5, atol=1e-6)
    assert sure.mean() > 0.5


@given(seed=st.integers(0, 2**31 - 1), h=st.floats(1e-3, 1e3))
def test_the_lattice_is_a_rotated_cube_of_step_h(seed, h):
    lattice = Lattice(Prepared(random_scene(seed, h, 2.0, 1)).soft.lattice.position)
    np.testing.assert_allclose(lattice.axes.T @ lattice.axes, h * h * np.eye(3), rtol=0, atol=1e-12 * h * h)
    assert np.linalg.det(lattice.axes) > 0


def test_without_rotation_nodes_lie_on_multiples_of_h():
    scene = random_scene(1, 0.25, 2.0, 1, lattice_rotation=False, lattice_origin=(0.125, -3.0, 7.0))
    nodes = np.array([(0, 0, 0), (4, -8, 1), (-400, 13, 1000)], np.int32)
    np.testing.assert_array_equal(Prepared(scene).soft.lattice.position(nodes), [0.125, -3, 7] + 0.25 * nodes)


@pytest.mark.parametrize("kI", [0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0])
def test_the_set_above_a_plane_has_its_volume_in_nodes(kI):
    scene = random_scene(0, 0.02, kI, 1)
    P = np.random.default_rng(0).uniform((-1, -1, 50.0), (1, 1, 50.0), (2000, 3))  # far above everything
    start, _ = Prepared(scene).soft.interpolation_set(P, np.tile([0.0, 0.0, 1.0], (2000, 1)))
    counts = np.diff(start)
    assert counts.mean() == pytest.approx(2 / 3 * np.pi * kI**3, rel=0.05)
    if kI >= 1.225:
        assert counts.min() > 0
