"""Soft shadows by light meshes, the method of this project: Ψ for opaque surfaces, and eq. (7) where they let light
through.
"""

from __future__ import annotations

from .method import Kind, Setup
from .psi import LightMeshes
from .semitransparent import SemitransparentMeshes


def make(setup: Setup) -> LightMeshes:
    """Return light meshes whose nodes hold bits, or numbers if surfaces let light through."""
    assert setup.lattice is not None
    return (SemitransparentMeshes if setup.through.channels else LightMeshes)(setup, setup.lattice)


KIND = Kind(make, soft=True, lattice=True, bends=True, counts=True)
