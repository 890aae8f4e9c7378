"""Rows of arrays against numpy (rows.py), and kernels whose first arguments are given once (native.py)."""

import numpy as np
import pytest
from light_meshes.support import native
from light_meshes.support.rows import taken, where


@pytest.mark.parametrize("shape", [(0,), (7,), (7, 3), (7, 2), (7, 5)])
@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int32, np.uint64, np.bool_])
def test_rows_are_those_of_numpy(shape, kind):
    array = np.random.default_rng(0).integers(0, 2 if kind is np.bool_ else 99, shape).astype(kind)
    for rows in (np.arange(len(array)), np.arange(len(array))[::-2].copy(), np.zeros(0, np.int64)):
        found = taken(array, rows)
        assert found.dtype == array.dtype and (found == array[rows]).all() and found.base is None
    every_second = np.repeat(array, 2, axis=0)[::2]  # not contiguous
    assert (taken(every_second, np.arange(len(array))) == array).all()


@pytest.mark.parametrize("n", [0, 1, 65, 1000])
def test_masks_are_listed(n):
    mask = np.random.default_rng(n).random(n) < 0.3
    assert (where(mask) == np.flatnonzero(mask)).all() and (where(mask, False) == np.flatnonzero(~mask)).all()
    assert where(mask).dtype == np.int64


P = np.arange(12.0).reshape(4, 3)


def test_a_kernel_with_given_arguments_does_the_same():
    kernel = native.kernel("shading_mirrored")
    whole, rest = np.empty((4, 3)), np.empty((4, 3))
    kernel(-P, P, P, whole)
    kernel.of(-P, P)(P, rest)
    assert (whole == rest).all()


@pytest.mark.parametrize(("first", "rest", "error"), [
    ((P, P[:3]), (P, P.copy()), ValueError),
    ((P.astype(np.float32),), (P, P, P.copy()), TypeError),
    ((P, P), (P[:3], P.copy()), ValueError),
    ((P, P), (P, P.astype(np.int64)), TypeError),
    ((P, P), (P,), TypeError),
    ((P, P), (P, np.broadcast_to(0.0, (4, 3))), ValueError),
])
def test_a_wrong_call_with_given_arguments_is_an_error(first, rest, error):
    with pytest.raises(error):
        native.kernel("shading_mirrored").of(*first)(*rest)
