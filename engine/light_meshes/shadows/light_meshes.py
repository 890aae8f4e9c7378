"""Soft shadows by light meshes, the project's method: Ψ for opaque surfaces, eq. (7) where they let light through."""

from __future__ import annotations

from .method import Kind, Setup
from .psi import LightMeshes
from .semitransparent import SemitransparentMeshes


def make(setup: Setup) -> LightMeshes:
    """Light meshes with bits at the nodes, or numbers where surfaces let light through."""
    assert setup.lattice is not None
    return (SemitransparentMeshes if setup.through.channels else LightMeshes)(setup, setup.lattice)


KIND = Kind(make, soft=True, lattice=True, bends=True, counts=True)
