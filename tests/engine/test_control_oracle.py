"""Every combination of the artist's controls, on random scenes, agrees with the simple oracle."""

from dataclasses import replace

import numpy as np
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from light_meshes.picture.render import Prepared
from light_meshes.scene.description import WEIGHTS, Light, Object
from light_meshes.shadows.meshes.lattice import lattice
from oracle import Lattice, Oracle
from scenes import combined, random_scene
from test_semitransparent import glass


def controlled(seed, h, kI, lights, **values):
    """A random scene with random flags, radii and links."""
    scene = random_scene(seed, h, kI, lights, **values)
    random = np.random.default_rng(seed + 1)

    def flags(of, **likely):
        return replace(of, **{name: bool(random.random() < share) for name, share in likely.items()})

    def some():
        if random.random() < 0.6:
            return None
        return tuple(np.flatnonzero(random.random(len(scene.objects)) < 0.6).tolist())

    def light(of: Light) -> Light:
        of = replace(of, soft_radius=float(random.choice([0.0, random.uniform(0.3, 4.5) * h])),
                     softness=str(random.choice(["SCENE", "RADIUS"])), receivers=some(), blockers=some())
        if of.type == "SUN" and scene.settings.weights == "UNIFORM" and random.random() < 0.5:
            of = replace(of, softness="LIGHT_SIZE", angle=0.4, reference_distance=float(random.uniform(0.5, 2)))
        return flags(of, soft_shadows=0.85, cast_shadow=0.9)

    return replace(
        scene, lights=tuple(light(of) for of in scene.lights),
        objects=tuple(flags(o, visible_shadow=0.9, cast_soft_shadows=0.75, receive_soft_shadows=0.85)
                      for o in scene.objects),
        materials=tuple(flags(m, cast_soft_shadows=0.85, receive_soft_shadows=0.9) for m in scene.materials))


COMBINED = {"seed": st.integers(0, 2**31 - 1), "h": st.floats(0.15, 0.3), "kI": st.floats(0.5, 4.0),
            "lights": st.integers(1, 9), "weights": st.sampled_from(WEIGHTS)}


def agrees(scene, seed, prepared=None):
    """S of random receivers is the oracle's."""
    prepared = prepared or Prepared(scene)
    oracle = Oracle(scene, Lattice(lattice(scene.settings.h, np.ones(1)).position))
    P, N, triangle = oracle.places(25, seed)
    S = prepared.light_visibility(P, N, triangle)
    S = S.reshape(len(P), len(scene.lights), -1)
    answers = [oracle.soft(*place) for place in zip(P, N, triangle, strict=True)]
    for k, (expected, sure) in enumerate(answers):
        if sure:
            np.testing.assert_allclose(S[k], np.repeat(expected[:, None], S.shape[2], 1), rtol=0, atol=1e-6)
    assume(sum(sure for _, sure in answers) > len(P) / 4)
    return prepared


@hypothesis_settings(max_examples=100)
@given(**COMBINED, skip=st.booleans())
def test_any_combination_is_the_oracles(seed, h, kI, lights, weights, skip):
    agrees(controlled(seed, h, kI, lights, weights=weights, uniform_skip=skip), seed)


@given(**COMBINED, colour=st.booleans())
def test_any_combination_is_the_oracles_where_nodes_hold_numbers(seed, h, kI, lights, weights, colour):
    """Glass that no shadow ray meets, but that the plan must be ready for."""
    scene = controlled(seed, h, kI, lights, weights=weights)
    g = scene.geometry
    with_glass = replace(
        scene, materials=(*scene.materials, glass((0.5, 0.4, 0.3) if colour else 0.5)),
        objects=(*scene.objects, Object("unseen glass", visible_shadow=False)),
        geometry=replace(
            g, triangles=np.concatenate([g.triangles, g.triangles[:1]]),
            corner_normals=np.concatenate([g.corner_normals, g.corner_normals[:1]]),
            triangle_materials=np.append(g.triangle_materials, np.int32(len(scene.materials))),
            meshes=np.concatenate([g.meshes, [[*g.meshes[0, :2], len(g.triangles), 1]]]),
            instance_mesh=np.append(g.instance_mesh, np.int32(len(g.meshes))),
            instance_object=np.append(g.instance_object, np.int32(len(scene.objects))),
            instance_matrix=np.concatenate([g.instance_matrix, g.instance_matrix[:1]])))
    prepared = Prepared(with_glass)
    assume(prepared.plan.channels == (3 if colour else 1))
    agrees(scene, seed, prepared)


@hypothesis_settings(max_examples=5)
@given(seed=st.integers(0, 2**31 - 1), shadows=st.sampled_from(["SHARP", "LIGHT_MESHES"]))
def test_pixels_are_the_oracles(seed, shadows):
    scene = controlled(seed, 0.2, 1.8, 4, shadows=shadows)
    oracle = Oracle(scene, Lattice(lattice(0.2, np.ones(1)).position))
    expected, sure = oracle.picture()
    np.testing.assert_allclose(combined(scene)[sure], expected[sure], rtol=1e-5, atol=1e-6)
    assert sure.mean() > 0.5
