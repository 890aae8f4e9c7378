"""Embree by its own C interface against embreex's `run`: the same answers, bit by bit."""

import numpy as np
import pytest
from light_meshes.gathered.directions import directions as gathering
from light_meshes.picture.render import render_image
from light_meshes.rays import embree, tracer
from light_meshes.rays.tracer import directions
from scenes import four_lights, tabletop


def soup(triangles, seed=0):
    """Triangles of all sizes, some of them in strips that share edges and vertices."""
    random = np.random.default_rng(seed)
    corners = random.uniform(-1, 1, (triangles, 1, 3)) + random.uniform(-0.3, 0.3, (triangles, 3, 3))
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20), indexing="ij"), -1).reshape(-1, 2)
    sheet = np.concatenate([grid, 0.2 * np.sin(3 * grid[:, :1] + 2 * grid[:, 1:])], 1)
    k = (np.arange(19)[:, None] * 20 + np.arange(19)).ravel()
    faces = np.concatenate([np.stack([k, k + 1, k + 20], 1), np.stack([k + 1, k + 21, k + 20], 1)])
    vertices = np.concatenate([corners.reshape(-1, 3), sheet]).astype(np.float32)
    return vertices, np.concatenate([np.arange(3 * triangles).reshape(-1, 3), faces + 3 * triangles]).astype(np.int32)


def rays(vertices, faces, n, seed=1):
    """Rays of any kind: to anywhere, to vertices, to the middles of edges, from surfaces, short and long."""
    random = np.random.default_rng(seed)
    o = random.uniform(-1.5, 1.5, (n, 3))
    to = random.uniform(-1, 1, (n, 3))
    corners = vertices[faces[random.integers(len(faces), size=n)]].astype(np.float64)
    to[::4] = corners[::4, 0]
    to[1::4] = (corners[1::4, 0] + corners[1::4, 1]) / 2
    o[::5] = corners[::5].mean(1)
    o = o.astype(np.float32)
    d = (to - o).astype(np.float32)
    return o, d, random.uniform(0.5, 1.5, n).astype(np.float32)


@pytest.fixture(scope="module")
def both():
    """The two, of the same triangles, and those."""
    assert embree._device() is not None, "embreex's library has not been found"
    shape = soup(100)
    return embree.Direct(*shape), embree.ByRun(*shape), shape


@pytest.mark.parametrize("n", [1, 7, 16, 17, 100_003])
def test_ready_made_rays_meet_the_same(both, n):
    direct, by_run, shape = both
    o, d, t = rays(*shape, n)
    blocked = direct.occluded(o, d, t)
    assert (blocked == by_run.occluded(o, d, t)).all()
    far, farther = t.copy(), t.copy()
    one, other = direct.closest(o, d, far), by_run.closest(o, d, farther)
    hit = other.triangle >= 0
    assert (one.triangle == other.triangle).all() and (far == farther).all()
    assert (one.u[hit] == other.u[hit]).all() and (one.v[hit] == other.v[hit]).all()
    assert n < 100 or (0.1 < blocked.mean() < 0.9 and 0.1 < hit.mean() < 0.9)


@pytest.mark.parametrize("normals", [False, True])
def test_rays_made_on_the_way_meet_the_same(both, normals):
    direct, by_run, shape = both
    n = 40_001
    o, d, t = (a.astype(np.float64) for a in rays(*shape, n))
    random = np.random.default_rng(2)
    unit = d / np.linalg.norm(d, axis=1, keepdims=True)
    frame = np.array([0.1, 0.2, 0.3]), 1.7, 1.0
    normal = -unit if normals else None
    for length in (None, t):
        one, other = (a.closest_of(*frame, o, unit, normal, length) for a in (direct, by_run))
        hit = other.triangle >= 0
        assert 0.1 < hit.mean() < 0.9 and (one.triangle == other.triangle).all() and (one.u[hit] == other.u[hit]).all()
    target, directional = random.uniform(-1, 1, (50, 3)), random.random(50) < 0.3
    which, to = random.integers(n, size=n).astype(np.int32), random.integers(50, size=n).astype(np.int32)
    for closed in (False, True):
        segments = *frame, o, normal, which, target, directional, to, closed
        one, other = (a.occluded_of(*segments) for a in (direct, by_run))
        assert 0.1 < one.mean() < 0.9 and (one == other).all()


def edges(vertices, faces, n, seed=4):
    """Parallel rays, as of an orthographic camera, that meet edges and vertices of triangles as exactly as can be."""
    random = np.random.default_rng(seed)
    corners = vertices[faces[random.integers(len(faces), size=n)]].astype(np.float64)
    share = random.random((n, 1)) * (random.random((n, 1)) < 0.7)
    at = corners[:, 0] * share + corners[:, 1] * (1 - share)
    at = at[np.lexsort(at.T)]
    return at + np.array([0, 0, 4]), np.broadcast_to([0.0, 0.0, -1.0], (n, 3)).copy()


@pytest.mark.parametrize("samples, left", [(1, 0), (3, 5), (4, 1), (8, 0), (25, 3)])
def test_camera_rays_meet_the_same_in_packets(both, samples, left):
    """Also at edges, where two triangles are equally far; and whatever part of the rows is asked, in which order."""
    direct, by_run, shape = both
    wide, frame = 40, (np.zeros(3), 1.0, 4.0)
    n = wide * samples * 25
    o, d, t = (a.astype(np.float64) for a in rays(*shape, n))
    sheet = shape[1][100:]  # edges that are shared
    fan = np.array([0.3, 0.2, 2.0])
    above, down = edges(shape[0], sheet, n)
    for origin, way in ((above, down), (o, d), (np.tile(fan, (n, 1)), above - np.array([0, 0, 4]) - fan)):
        unit = way / np.linalg.norm(way, axis=1, keepdims=True)
        for length in (None, 3 * t):
            expected = by_run.closest_of(*frame, origin, unit, None, length)
            hit = expected.triangle >= 0
            assert hit.mean() > 0.1
            blocks = np.arange(n).reshape(25, wide // 8, 8 * samples).swapaxes(0, 1).ravel()
            for some in (np.arange(n), np.arange(0, n, 3), blocks, np.flatnonzero(t > 0.8)):
                pixels = tracer.Pixels(some, left, wide, samples)
                end = None if length is None else length[some]
                for one in (direct, by_run):
                    met = one.closest_of_pixels(*pixels, *frame, origin[some], unit[some], end)
                    assert (met.triangle == expected.triangle[some]).all()
                    assert (met.u[hit[some]] == expected.u[some][hit[some]]).all()
                    assert (met.v[hit[some]] == expected.v[some][hit[some]]).all()


@pytest.mark.parametrize("turned", [False, True])
def test_rays_around_points_meet_the_same(both, turned):
    """As rays that are made one by one: their directions are `local` in a frame square to the normal."""
    direct, by_run, _ = both
    random = np.random.default_rng(3)
    P, M = random.uniform(-1, 1, (300, 3)), random.normal(size=(300, 3))
    M /= np.linalg.norm(M, axis=1, keepdims=True)
    angle = random.uniform(0, 7, 300)
    turn = np.stack([np.cos(angle), np.sin(angle)], 1) if turned else None
    local, frame = gathering(70), (np.array([0.1, 0.2, 0.3]), 1.7, 1.0)
    one, other = (a.around(*frame, P, M, turn, local) for a in (direct, by_run))
    hit = other.triangle >= 0
    assert 0.1 < hit.mean() < 0.9 and (one.triangle == other.triangle).all()
    assert (one.u[hit] == other.u[hit]).all() and (one.v[hit] == other.v[hit]).all()

    way = directions(M, turn, local, np.arange(300 * 70)).reshape(300, 70, 3)
    np.testing.assert_allclose(np.linalg.norm(way, axis=2), 1, rtol=1e-12)
    np.testing.assert_allclose((way * M[:, None]).sum(2), np.broadcast_to(local[:, 2], (300, 70)), atol=1e-12)
    between = np.broadcast_to(local @ local.T, (300, 70, 70))
    np.testing.assert_allclose(way @ way.transpose(0, 2, 1), between, atol=1e-12)


def test_points_in_space_see_the_same_lights(both):
    direct = both[0]
    random, n, lights = np.random.default_rng(3), 700, 70
    frame = np.array([0.1, 0.2, 0.3]), 1.7, 1.0
    origin, position = random.uniform(-1.5, 1.5, (n, 3)), random.uniform(-2, 2, (lights, 3))
    directional = random.random(lights) < 0.3
    asked = random.integers(0, 2**63, (n, 2), np.uint64) * np.uint64(2)
    among = np.array([~np.uint64(0), np.uint64(0b1011)])
    row, light = (a.astype(np.int32) for a in np.nonzero(np.unpackbits(
        (asked & among).view(np.uint8), axis=1, bitorder="little")[:, 3:lights]))
    seen = np.zeros((n, 128), np.uint8)
    light += 3
    seen[row, light] = ~direct.occluded_of(*frame, origin, None, row, position, directional, light, False)
    expected = np.packbits(seen, axis=1, bitorder="little").view(np.uint64)
    for one in both[:2]:
        found = np.zeros((n, 2), np.uint64)
        rays = one.lit(*frame, origin, position, directional, asked, among, 3, lights + 5, found)
        assert rays == len(row) > 1000 and (found == expected).all()
    assert 0.1 < seen.sum() / len(row) < 0.9


@pytest.mark.parametrize("most", [1 << 20, 500])
def test_points_on_surfaces_see_the_same_near_them(both, most):
    random, n = np.random.default_rng(4), 300
    frame = np.array([0.1, 0.2, 0.3]), 1.7, 1.0
    origin, position = random.uniform(-1, 1, (n, 3)), random.uniform(-1, 1, (50, 3))
    normal = random.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ends = np.cumsum(random.integers(0, 9, (n, 2)).ravel()).reshape(n, 2)
    start = np.concatenate([np.append(0, ends[:-1, 1])[:, None], ends], axis=1)
    end = np.where(random.random(n) < 0.7, start[:, 1], start[:, 0])
    target = random.integers(50, size=start[-1, -1]).astype(np.int32)
    known = random.random(len(target)) < 0.3
    expected, rays = known.copy(), 0
    for p in range(n):
        k = np.flatnonzero(~known[start[p, 0]:end[p]]) + start[p, 0]
        segments = np.full(len(k), p, np.int32), position, np.zeros(50, np.bool_), target[k], True
        expected[k] = ~both[0].occluded_of(*frame, origin, normal, *segments)
        rays += len(k)
    for one in both[:2]:
        seen, state, calls = known.copy(), np.zeros(2, np.int64), 0
        while state[0] < n:
            one.near(*frame, origin, normal, position, start, end, target, most, seen, state)
            calls += 1
        assert (seen == expected).all() and state.tolist() == [n, rays] and rays > 500 and (calls > 1) == (most == 500)
    assert known.sum() < expected.sum() < len(known)


def test_nothing_meets_nothing():
    shape = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
    o, d, t = rays(*soup(10), 33)
    for accelerator in embree.Direct(*shape), embree.ByRun(*shape):
        assert not accelerator.occluded(o, d, t).any()
        assert (accelerator.closest(o, d, t.copy()).triangle == -1).all()


@pytest.mark.parametrize("scene", [tabletop, four_lights])
def test_pictures_do_not_depend_on_the_way_to_embree(scene, monkeypatch):
    scene = scene(60, shadows="LIGHT_MESHES", samples=4)
    direct = render_image(scene).passes["Combined"]
    monkeypatch.setattr(embree, "_made", lambda: None)
    built = []
    monkeypatch.setattr(tracer, "accelerator", lambda *shape: built.append(embree.accelerator(*shape)) or built[-1])
    by_run = render_image(scene).passes["Combined"]
    assert built and all(isinstance(a, embree.ByRun) for a in built)
    assert (direct == by_run).all() and direct.std() > 0.01


def test_another_version_of_embree_is_not_called(monkeypatch):
    monkeypatch.setattr(embree, "VERSION", 5)
    assert embree._made.__wrapped__() is None


def test_without_the_library_embreex_is_called(monkeypatch):
    monkeypatch.setattr(embree, "_libraries", list)
    assert embree._made.__wrapped__() is None
