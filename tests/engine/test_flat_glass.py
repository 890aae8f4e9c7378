"""Photons through blocks of flat glass: each arrives on a path that the solver finds, also where it grazes."""

import numpy as np
import pytest
from light_meshes import Shape
from refraction_reference import Lab, Stuff, rotation
from test_glass_light import cut_box, refracted

NEAR = 3e-7  # of rounded vertices: by how much a path may be another; at the cosine c of its way out, over c²


def photons(lab, n, count, random):
    """Where photons through random points of the faces leave a block (m,3), with which cosine (m,), and land (m,3).

    Not those within rounding of an edge: which face they meet is in doubt.
    """
    planes = {tuple(np.round([*N, A @ N], 5)): (N, A @ N) for A, N in zip(lab.A, lab.Ng, strict=True)}
    N, d = (np.array(list(column)) for column in zip(*planes.values(), strict=True))
    triangle = random.integers(len(lab.A), size=count)
    u, v = random.random((2, count))
    u, v = np.where(u + v > 1, [1 - u, 1 - v], [u, v])
    a = lab.A[triangle] + u[:, None] * lab.B[triangle] + v[:, None] * lab.C[triangle]
    D = (a - lab.light) / np.linalg.norm(a - lab.light, axis=1)[:, None]
    faces = (D * lab.Ng[triangle]).sum(1) < 0
    a, triangle = a[faces], triangle[faces]
    D, _ = refracted(D[faces], lab.Ng[triangle], 1 / n)
    slope, room = D @ N.T, d - a @ N.T
    t = np.where((slope > 1e-12) & (room > 1e-9), room / np.where(slope > 1e-12, slope, 1), np.inf)
    wall = t.argmin(1)
    b = a + t.min(1)[:, None] * D
    out, leaves = refracted(D, -N[wall], n)
    cosine = (out * N[wall]).sum(1)
    edge = np.sort(np.stack([np.abs(room), np.abs(d - b @ N.T)], 1), axis=2)[:, :, 1].min(1)
    sure = leaves & (out[:, 2] < 0) & (edge > 1e-6 + NEAR / np.maximum(cosine, 1e-9) ** 2)
    b, out, cosine = b[sure], out[sure], cosine[sure]
    return b, cosine, b - (b[:, 2] / out[:, 2])[:, None] * out


@pytest.mark.parametrize("cuts", [1, 2, 4])
@pytest.mark.parametrize("seed", [2, 3, 8, 11, 18, 25, 30, 44])
def test_every_photon_is_found(seed, cuts):
    """Blocks of any index, size and turn. Without `least_way.h` some of the light is lost in most of them."""
    random = np.random.default_rng(seed)
    n, half, matrix = random.uniform(1.1, 1.8), random.uniform(0.1, 0.6, 3), np.eye(4)
    if random.random() < 0.7:
        matrix = rotation(seed)
    matrix[:3, 3] = 0, 0, random.uniform(0.9, 1.4)
    light = np.array([*random.uniform(-2, 2, 2), random.uniform(2.2, 4)])
    lab = Lab([(Shape(cut_box(half, cuts), name="block", matrices=[matrix]), Stuff(n, 1.0))], light)
    b, cosine, x = photons(lab, n, 20000, random)
    near = (np.abs(x) < 8).all(1) & (cosine > (0.005 if cuts == 1 else 0.05))  # faces that are cut are not quite flat
    b, cosine, x = b[near], cosine[near], x[near]
    found, _ = lab.solver.paths(0, x)
    row = np.repeat(np.arange(len(x)), np.diff(found.start))
    known = np.zeros(len(x), np.bool_)
    known[row[np.linalg.norm(found.P - b[row], axis=1) < 1e-6 + NEAR / cosine[row] ** 2]] = True
    assert len(x) > 500 and known.all(), f"n = {n:.2f}: {(~known).sum()} of {len(x)} are lost, near {x[~known][:3]}"
