"""Procedural textures without Blender: every choice of every texture, point by point as in a batch, and at odd places.
That they look as Blender's do is tested beside Cycles: `tests/peers/test_node_textures.py`.
"""

import itertools

import numpy as np
import pytest
from light_meshes.surface.procedural import TEXTURES

ODD = np.array([0.0, 0.3, -7.7, 1e6, -3e9, 1e30, -1e300, np.inf, -np.inf, np.nan])
# Texture → its choices, and how many registers are its place, and are the rest.
CHOICES = {
    "noise": (itertools.product((1, 2, 3, 4), range(5), (0, 1)), 4, 6),
    "white_noise": (itertools.product((1, 2, 3, 4)), 4, 0),
    "bend": ([()], 3, 2),
    "voronoi": (itertools.product((1, 2, 3, 4), range(5), range(4), (0, 1), (0, 1)), 4, 6),
    "brick": (itertools.product((0.5,), (0, 2), (0.7,), (0, 3)), 2, 5),
}
CASES = [(name, choices, place, rest) for name, (many, place, rest) in CHOICES.items() for choices in many]


@pytest.mark.parametrize(("name", "choices", "place", "rest"), CASES)
def test_a_point_alone_is_as_in_a_batch(name, choices, place, rest):
    random = np.random.default_rng(len(CASES))
    columns = [*random.uniform(-20, 20, (place, 5)), *random.uniform(0, 1, (rest, 5))]
    together = np.stack(TEXTURES[name](5, *choices, *columns), axis=1)
    assert np.isfinite(together).all()
    alone = [TEXTURES[name](1, *choices, *(column[k:k + 1] for column in columns)) for k in range(5)]
    assert np.array_equal(together, [[register[0] for register in one] for one in alone])


@pytest.mark.parametrize(("name", "choices", "place", "rest"), CASES)
def test_odd_numbers_end(name, choices, place, rest):
    """Numbers that a program may come to, however large, or none: there is an answer, and no crash."""
    random = np.random.default_rng(len(CASES))
    columns = [random.permutation(ODD) for _ in range(place + rest)]
    assert all(len(register) == len(ODD) for register in TEXTURES[name](len(ODD), *choices, *columns))


@pytest.mark.parametrize("depth", range(11))
def test_magic(depth):
    columns = np.random.default_rng(depth).uniform(-20, 20, (4, 5))
    together = np.stack(TEXTURES["magic"](5, *columns, depth), axis=1)
    assert np.isfinite(together).all()
    assert np.array_equal(together[2:3], np.stack(TEXTURES["magic"](1, *columns[:, 2:3], depth), axis=1))
    TEXTURES["magic"](len(ODD), *(np.roll(ODD, k) for k in range(4)), depth)
