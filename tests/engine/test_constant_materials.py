"""Constant materials cost nothing: no program is run for them, and their bits do not depend on who has one."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes.picture.render import prepare, render_image
from light_meshes.scene.programs import program
from light_meshes.surface import looks
from scenes import tabletop

# The tabletop's colour as a constant, times 1 + 0·x: the same numbers, computed at each point.
SAME = {"operations": [["position"], ["multiply", [0], 0.0], ["add", [3], 1.0],
                       *(["multiply", [4], c] for c in (0.7, 0.6, 0.5))], "values": {"Od": [[5], [6], [7]]}}
VARIES = {"operations": [["position"]], "values": {"Od": [[0], [1], [2]]}}


def with_program(scene, name, data):
    """Return the scene where the material of that name has a program."""
    return replace(scene, materials=tuple(
        replace(m, program=program(data, name)) if m.name == name else m for m in scene.materials))


@pytest.mark.parametrize("mode", ["RAY_CASTING", "WHITTED"])
def test_no_program_is_run(monkeypatch, mode):
    def run(*_):
        raise AssertionError("a program was run")
    scene = tabletop(60, mode=mode)
    monkeypatch.setattr(looks, "run", run)
    assert not prepare(scene, ["Combined"]).world.looks.any
    assert render_image(scene).passes["Combined"].max() > 0.1
    with pytest.raises(AssertionError, match="a program was run"):
        render_image(with_program(scene, "tabletop", SAME))


def test_a_program_that_gives_constants_has_their_bits():
    scene = tabletop(60)
    np.testing.assert_array_equal(render_image(with_program(scene, "tabletop", SAME)).passes["Combined"],
                                  render_image(scene).passes["Combined"])


def test_what_has_no_program_has_its_bits_beside_one():
    scene = replace(tabletop(60), materials=tuple(replace(m, index=i) for i, m in enumerate(tabletop(60).materials)))
    plain, other = (render_image(s, ["Combined", "Material Index"]).passes
                    for s in (scene, with_program(scene, "tabletop", VARIES)))
    table = plain["Material Index"][..., 0] == [m.name for m in scene.materials].index("tabletop")
    assert 0.1 < table.mean() < 0.9
    np.testing.assert_array_equal(plain["Combined"][~table], other["Combined"][~table])
    assert (plain["Combined"][table] != other["Combined"][table]).any()
