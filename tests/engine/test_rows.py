"""Rows of arrays against numpy (rows.py), and kernels whose first arguments are given once (native.py)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from light_meshes.shadows import pairs
from light_meshes.support import native
from light_meshes.support.rows import even, put, taken, where


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


@pytest.mark.parametrize("words", [1, 3])
def test_words_are_put_where_they_belong(words):
    random = np.random.default_rng(words)
    rows, whole = np.flatnonzero(random.random(50) < 0.4), random.integers(0, 99, (50, words)).astype(np.uint64)
    values, expected = np.arange(len(rows) * words, dtype=np.uint64).reshape(-1, words), whole.copy()
    expected[rows] = values
    put(whole, rows, values)
    assert (whole == expected).all()


@given(n=st.integers(0, 10**6), most=st.integers(1, 10**5))
def test_batches_are_few_and_even(n, most):
    step = even(n, most)
    sizes = [min(step, n - i) for i in range(0, n, step)]
    assert sum(sizes) == n and len(sizes) == -(-n // most)
    assert not sizes or (max(sizes) <= most and max(sizes) - min(sizes) < len(sizes))


@pytest.mark.parametrize("channels", [1, 3])
def test_what_is_dark_is_0_but_where_it_will_be_set(channels):
    some = np.array([[0, 0], [0, 4], [1, 0], [0, 0]], np.uint64)
    assert not pairs.dark(4, 70, channels).any() and pairs.dark(0, 5).shape == (0, 5, 1)
    assert not pairs.dark(4, 70, channels, some)[[0, 3]].any()


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
