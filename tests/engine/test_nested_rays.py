"""Records send some rays first, and others where these leave their light uncertain (directions.py, records.py)."""

import numpy as np
import pytest
from light_meshes.gathered.directions import directions, nested
from light_meshes.gathered.grids import Places
from light_meshes.gathered.light import together
from light_meshes.gathered.records import RAYS
from light_meshes.picture.render import Prepared
from test_sectors import POINT, beside_a_wall

COUNTS = [n for _, n in RAYS]


def mean_error(local):
    """The RMS error of the mean over directions of which balls of all sizes hide some."""
    random = np.random.default_rng(2)
    toward = random.normal(size=(400, 3))
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    toward[:, 2] = np.abs(toward[:, 2])
    hidden = np.cos(np.radians(random.uniform(8, 85, 400)))

    def share(some):
        return np.mean([(part @ toward.T > hidden).mean(0) for part in np.array_split(some, len(some) // 256)], axis=0)

    return np.sqrt(np.square(share(local) - share(directions(1 << 14))).mean())


@pytest.mark.parametrize("n", COUNTS)
def test_each_set_is_spread_about_as_evenly_as_one_made_at_once(n):
    rays = nested(n)
    for local in (rays.first.local, *(both.local for both in rays.all.values())):
        assert mean_error(local) < 1.25 * mean_error(directions(len(local)))


@pytest.mark.parametrize("n", COUNTS)
def test_the_first_and_more_rays_are_all_rays(n):
    rays, full = nested(n), nested(n).all[4].local
    for times, more in rays.more.items():
        np.testing.assert_array_equal(rays.all[times].local, np.concatenate([rays.first.local, more]))
    assert len(np.unique(full, axis=0)) == 4 * n
    np.testing.assert_allclose(np.sort(full[:, 2]), np.sort(directions(4 * n)[:, 2]), rtol=0, atol=1e-15)


def test_rays_that_are_added_find_what_they_find_at_once():
    """The same bits, of all that a record keeps."""
    ready = Prepared(beside_a_wall(bounces=2))
    records = ready.lighting.everywhere
    way = np.array([(0.0, 0.0, -1.0), (0.5, 0.0, -0.75**0.5)])
    _, hits = ready.world.closest("camera", POINT - 0.3 * way, way)
    records(hits, lambda: None)
    places = records._field.grids.places(records._table.keys[records._done[:len(records)]])
    assert len(places.P) >= 3
    rows, rays = np.arange(0, len(places.P), 2), nested(256)
    some = Places._make(a[rows] for a in places)
    first = records._ask(places, rays.first.local, lambda: None)
    for times, all_rays in rays.all.items():
        both = together(first, rows, records._ask(some, rays.more[times], lambda: None))
        once = records._ask(some, all_rays.local, lambda: None)
        assert 0 < np.count_nonzero(both.number >= 0) < both.number.size  # some see the wall, some the sky
        for a, b in zip(*(records._summed(light, all_rays)[0] for light in (both, once)), strict=True):
            np.testing.assert_array_equal(a, b)
