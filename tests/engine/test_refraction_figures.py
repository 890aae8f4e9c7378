"""Refracted shadow paths, eq. (6): how many are found, how exact they are, and their cost; the sphere in one dimension.

`recall` sends light forward through the same mesh with a tracer that shares no code with the solver, and asks the
solver for the path at a point that this light reaches; `Lab.error` traces a path of the solver back to the light.
"""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from light_meshes import Shape, box, cylinder, rectangle, scale, sphere, translate
from light_meshes.glass.refraction import Paths, RefractedPaths
from refraction_reference import FLOOR, GLASS, Lab, Stuff, only, paths, rotation, sphere_exits, sphere_roots, torus


def same(a: Paths, b: Paths) -> bool:
    return all(np.array_equal(p, q) for p, q in zip(a, b, strict=True))


def rejoin(parts: list[Paths]) -> Paths:
    start = np.concatenate([[0], np.cumsum(np.concatenate([np.diff(p.start) for p in parts]))])
    return Paths(start, *(np.concatenate(column) for column in zip(*(p[1:] for p in parts), strict=True)))


def recall(lab: Lab, count: int, size: float, seed: int = 0) -> tuple[float, Paths, np.ndarray]:
    """Share of forward paths that the solver finds again, within 1e-6·size and with the right Π t."""
    rng = np.random.default_rng(seed)
    x, ends, alphas = [], [], []
    while len(x) < count:
        ray = lab.towards(rng.uniform(-size, size, 3))
        if len(ray.points):
            k = rng.integers(len(ray.points))
            length = ray.lengths[k + 1] if k + 1 < len(ray.lengths) else 0.0
            x.append(ray.points[k] + min(length, 4.0) * rng.uniform(0.02, 0.98) * ray.directions[k + 1])
            ends.append(ray.points[k])
            alphas.append(ray.alpha[k])
            if length == 0.0:
                x.pop(), ends.pop(), alphas.pop()
    x = np.array(x)
    found, _ = lab.solver.paths(0, x)
    hits = 0
    for i in range(count):
        row = slice(found.start[i], found.start[i + 1])
        near = np.linalg.norm(found.P[row] - ends[i], axis=1) < 1e-6 * size
        hits += bool(near.any())
        assert np.allclose(found.alpha[row][near], alphas[i], rtol=1e-12)
    return hits / count, found, x


def errors(lab: Lab, found: Paths, x: np.ndarray, most: int = 200) -> np.ndarray:
    """By how much (up to `most`) paths miss the light when traced back from their points."""
    row = np.repeat(np.arange(len(x)), np.diff(found.start))
    some = range(0, len(row), max(1, len(row) // most))
    return np.array([lab.error(x[row[c]], found.arrival[c], found.P[c]) for c in some])


# --- Known answers ----------------------------------------------------------------------------------------



@pytest.mark.slow
def test_sphere_against_root_finding():
    """Issue's figure: ≥ 99.5 % of 10,000 nodes with the right number of paths.

    The mesh's own limb lies inside the sphere's: at half an edge's angle before grazing it ends, so that the share of
    right nodes measures the mesh (98.1, 98.9, 99.5, 99.8 % with 5, 20, 82, 331 thousand triangles). Away from the limb
    all must be right, at any of these.
    """
    rng = np.random.default_rng(1)
    x = rng.uniform((-3, -3, -4), (3, 3, 2), (30000, 3))
    x = x[np.linalg.norm(x, axis=1) > 1.0][:10000]
    across = np.hypot(x[:, 0], x[:, 1])
    row, phi = sphere_roots(np.stack([across, x[:, 2]], 1), 4.0, 1.5)
    expected = np.bincount(row, minlength=len(x))
    assert (expected > 0).sum() > 4000
    for segments, least in ((432, 0.995), (144, 0.985)):
        lab = Lab([(Shape(sphere(1, segments, segments // 2), matrices=[rotation(4)]), GLASS)], (0, 0, 4))
        found, work = lab.solver.paths(0, x)
        count = np.diff(found.start)
        right = count == expected
        edge = 2 * np.pi / segments
        limb = np.zeros(len(x), bool)
        limb[row[np.arccos(1 / 4) - abs(phi) < edge]] = True
        print(f"{segments * (segments - 2)} triangles: right {right.mean():.4f}, away from the limb "
              f"{right[~limb].mean():.5f}, {work}")
        assert right.mean() >= least
        assert right[~limb].mean() >= 0.9995
        single = (count == 1) & (expected == 1)
        P, _ = sphere_exits(phi[np.searchsorted(row, np.flatnonzero(single))], 4.0, 1.5)
        azimuth = x[single, :2] / across[single, None]
        shape = np.linalg.norm(found.P[found.start[:-1][single]] - np.c_[P[:, :1] * azimuth, P[:, 1]], axis=1)
        print(f"shape error of P: median {np.median(shape):.1e}, largest {shape.max():.1e}")
        assert np.median(shape) < edge**2  # of the mesh, not of the solver
        assert work.unconverged <= 0.03 * work.seeds


def test_sphere_is_exact_on_its_own_mesh():
    """Position error ≤ 1e-6 R, Snell residual ≤ 1e-6, against plain tracing on the same 5,000 triangles."""
    lab = Lab([(Shape(sphere(1, 72, 36), matrices=[rotation(1)]), GLASS)], (0, 0, 4))
    share, found, x = recall(lab, 400, 1.2)
    assert share >= 0.995
    assert errors(lab, found, x).max() < 1e-9


def test_focusing_is_the_derivative_of_what_light_does():
    lab = Lab([(Shape(sphere(1, 72, 36), matrices=[rotation(1)]), GLASS)], (0.3, 0, 4))
    sun = Lab(lab.parts, sun=(0.1, 0.2, -1))
    rng = np.random.default_rng(3)
    for n in range(60):
        one = sun if n % 2 else lab
        y = rng.uniform(-0.6, 0.6, 3)
        ray = one.towards(y)
        d = ray.directions[-1]
        x = ray.points[-1] + rng.uniform(0.3, 3) * d
        found = paths(one, x)
        k = np.argmin(np.linalg.norm(found.P - ray.points[-1], axis=1))
        a, b = np.linalg.svd(d[None])[2][1:]
        start = ray.directions[0]
        u, v = np.linalg.svd(start[None])[2][1:]
        e = 1e-7

        def landing(s, one=one, start=start, x=x, d=d, a=a, b=b, y=y):
            r = one.trace(y - 20 * start + s, start, {}) if one.sun is not None else one.trace(one.light, start + s, {})
            p = r.points[-1]
            p = p + ((x - p) @ d) / (r.directions[-1] @ d) * r.directions[-1]
            return np.array([p @ a, p @ b])

        m = np.stack([(landing(e * w) - landing(-e * w)) / (2 * e) for w in (u, v)])
        distance = 1.0 if n % 2 else np.linalg.norm(x - one.light)
        assert found.J[k] == pytest.approx(distance**2 / abs(np.linalg.det(m)), rel=1e-3)
        assert np.allclose(found.spread[k], np.linalg.svd(m)[1] / distance, rtol=1e-3)
        assert found.clamped(0.025)[k] <= found.J[k] * (1 + 1e-12)


# --- Any scene --------------------------------------------------------------------------------------------

SCENES = {
    "coarse sphere": ([(Shape(sphere(1, 16, 8), matrices=[rotation(1)]), GLASS)], (0, 0, 4)),
    "light inside": ([(Shape(sphere(1, 48, 24), matrices=[rotation(1)]), GLASS)], (0.3, 0.2, 0.1)),
    "flat sphere": ([(Shape(sphere(1, 16, 8, smooth=False), matrices=[rotation(1)]), GLASS)], (0, 0, 4)),
    "box": ([(Shape(box((-1, -1, -1), (1, 1, 1)), matrices=[rotation(2)]), GLASS)], (0, 0, 4)),
    "torus": ([(Shape(torus(1, 0.4, 64, 32), matrices=[rotation(3)]), GLASS)], (0, 0, 4)),
    "flat cylinder": ([(Shape(cylinder(0.6, -0.7, 0.7, 24), matrices=[rotation(3)]), GLASS)], (0, 0, 4)),
    "two in a row": ([(Shape(sphere(1, 48, 24), matrices=[rotation(1)]), GLASS),
                      (Shape(sphere(0.4, 32, 16), matrices=[translate(0.3, 0.2, -2)]), Stuff(1.3, 0.7))], (0, 0, 4)),
    "nested": ([(Shape(sphere(1, 48, 24), matrices=[rotation(1)]), GLASS),
                (Shape(sphere(0.6, 32, 16), matrices=[translate(0.2, 0, 0)]), Stuff(1.2, 0.8, 1))], (0, 0, 4)),
    "rod in a drink": ([(Shape(sphere(1, 48, 24), matrices=[rotation(1)]), Stuff(1.33)),
                        (Shape(box((-0.5, -0.5, -2), (0.5, 0.5, 2))), Stuff(1.6, 0.8, 1))], (0.1, 0.3, 4)),
}


@pytest.mark.parametrize("name", SCENES)
def test_light_sent_forward_is_found_again(name):
    parts, light = SCENES[name]
    lab = Lab(parts, light)
    share, found, x = recall(lab, 300, 1.2)
    assert share >= 0.98
    assert errors(lab, found, x, 60).max() < 1e-6


def test_sun_sent_forward_is_found_again():
    lab = Lab(SCENES["nested"][0], sun=(0.3, 0.2, -1))
    share, found, x = recall(lab, 200, 1.2)
    assert share >= 0.98
    assert errors(lab, found, x, 60).max() < 1e-6


@settings(max_examples=12)
@given(st.integers(0, 10**6), st.floats(1.05, 2.4), st.floats(0.05, 1.0), st.floats(0.3, 5))
def test_any_slab(seed, n, thickness, away):
    """One path to each point behind it; where it leaves follows from one unknown, the angle inside."""
    pose, rng = rotation(seed), np.random.default_rng(seed)
    slab = Shape(box((-60, -60, 0), (60, 60, thickness)), matrices=[pose])
    light = np.array([0.2, -0.1, thickness + away])
    lab = Lab([(slab, Stuff(n, 0.7))], pose[:3, :3] @ light)
    x = rng.uniform((-2, -2, -3), (2, 2, -0.05), (20, 3))
    found = only(lab, *(x @ pose[:3, :3].T))
    offset = x[:, :2] - light[:2]
    way = np.linalg.norm(offset, axis=1)
    low, high = np.zeros(len(x)), np.ones(len(x))  # of the sine outside
    for _ in range(80):
        s = (low + high) / 2
        out, inner = s / np.sqrt(1 - s * s), s / np.sqrt(n * n - s * s)
        short = out * (away - x[:, 2]) + inner * thickness < way
        low, high = np.where(short, s, low), np.where(short, high, s)
    leaves = np.c_[x[:, :2] - (out * -x[:, 2] / way)[:, None] * offset, np.zeros(len(x))]
    assert np.allclose(found.P, leaves @ pose[:3, :3].T, atol=2e-5)  # the mesh is float32 and 120 across
    assert np.allclose(found.alpha, 0.49)


@settings(max_examples=8)
@given(st.integers(0, 10**6), st.floats(1.05, 2.4), st.floats(1e-2, 1e2), st.floats(1.2, 8))
def test_any_sphere(seed, n, radius, away):
    rng = np.random.default_rng(seed)
    middle = rng.normal(size=3)
    toward = middle / np.linalg.norm(middle)
    pose = translate(*(radius * middle)) @ rotation(seed) @ scale(radius, radius, radius)
    lab = Lab([(Shape(sphere(1, 32, 16), matrices=[pose]), Stuff(n, 0.7))],
              radius * (middle + away * toward), h=0.05 * radius)
    # The lab's forward rays aim around the origin.
    moved = Lab([(Shape(sphere(1, 32, 16), matrices=[rotation(seed) @ scale(radius, radius, radius)]), Stuff(n, 0.7))],
                radius * away * toward, h=0.05 * radius)
    share, found, x = recall(moved, 60, 1.1 * radius, seed)
    assert share >= 0.95
    assert errors(moved, found, x, 30).max() < 1e-6 * radius
    elsewhere, _ = lab.solver.paths(0, x + radius * middle)
    assert (np.diff(elsewhere.start) != np.diff(found.start)).sum() <= 2  # but for rounding of the vertices


# --- Work -------------------------------------------------------------------------------------------------


def test_answers_do_not_depend_on_batches_order_or_threads():
    parts = [*SCENES["two in a row"][0], (Shape(rectangle((0, -2), (2, 2), 1.5)), None)]
    x = np.random.default_rng(10).uniform(-3, 2, (2000, 3))

    def fresh() -> RefractedPaths:
        return Lab(parts, (0, 0, 4)).solver

    whole = fresh().paths(0, x)[0]
    solver = fresh()
    assert same(whole, rejoin([solver.paths(0, x[i:i + 7])[0] for i in range(0, 70, 7)]
                              + [solver.paths(0, x[70:])[0]]))
    order = np.random.default_rng(11).permutation(len(x))
    mixed = fresh().paths(0, x[order])[0]
    one_by_one = rejoin([Paths(np.array([0, mixed.start[i + 1] - mixed.start[i]]),
                               *(a[mixed.start[i]:mixed.start[i + 1]] for a in mixed[1:]))
                         for i in np.argsort(order)])
    assert same(whole, one_by_one)
    solver, results = fresh(), [None, None]

    def work(k):
        results[k] = solver.paths(0, x[k * 1000:(k + 1) * 1000])[0]

    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    assert same(whole, rejoin(results))


def test_empty_scenes_and_batches():
    lab = Lab([(FLOOR, None)], (0, 0, 4))
    found, work = lab.solver.paths(0, np.zeros((3, 3)))
    assert found.start.tolist() == [0, 0, 0, 0] and work.rays == 0
    assert (lab.solver.straight(0, np.zeros((3, 3))) == 1).all()
    lab = Lab([(Shape(sphere(1, 16, 8)), GLASS)], (0, 0, 4))
    assert lab.solver.paths(0, np.zeros((0, 3)))[0].start.tolist() == [0]
    assert np.isfinite(paths(lab, (0, 0, 4), (0, 0, 1), (0, 0, 1e9)).arrival).all()


@pytest.mark.slow
def test_cost_of_100_000_nodes():
    """Issue's figure: ≤ 60 rays a node; ≤ 20 µs on two cores, as 40 µs of processor time (other work is running)."""
    lab = Lab([(Shape(sphere(1, 72, 36), matrices=[rotation(1)]), GLASS)], (0, 0, 4))
    x = np.random.default_rng(12).uniform((-3, -3, -5), (3, 3, 2), (120000, 3))
    x = x[np.linalg.norm(x, axis=1) > 1][:100000]
    lab.solver.paths(0, x[:10])
    works = [None, None]

    def run(k):
        works[k] = lab.solver.paths(0, x[k::2])[1]

    wall, start = time.perf_counter(), time.process_time()
    threads = [threading.Thread(target=run, args=(k,)) for k in range(2)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    spent = (time.process_time() - start) / len(x)
    rays, seeds, lost = (sum(getattr(w, name) for w in works) for name in ("rays", "seeds", "unconverged"))
    print(f"{rays / len(x):.1f} rays a node, {spent * 1e6:.1f} µs of processor time, "
          f"{(time.perf_counter() - wall) / len(x) * 1e6:.1f} µs on the clock, {lost / seeds:.2%} of seeds lost")
    assert rays <= 60 * len(x)
    assert spent <= 40e-6


def test_light_scattered_by_many_bodies_has_an_end(monkeypatch):
    """Beams have a budget; beyond it light is followed through fewer bends, and what is found is still true."""
    rng = np.random.default_rng(13)
    parts = [(Shape(sphere(0.2, 16, 8), matrices=[translate(*p)]), GLASS) for p in rng.uniform(-1, 1, (12, 3))]
    monkeypatch.setattr("light_meshes.glass.beams.BUDGET", (20000, 0))
    lab = Lab(parts, (0, 0, 4))
    assert lab.solver.beams(0).most < 8
    x = rng.uniform(-2, 2, (200, 3))
    found = paths(lab, *x)
    assert len(found.alpha)
    assert errors(lab, found, x, 60).max() < 1e-6
