"""Soft shadows by light meshes, the method of this project: Ψ for opaque surfaces, and eq. (7) where they let light
through.
"""

from __future__ import annotations

from ..support.bits import mask_of
from .casters import kept, union
from .method import Kind, Method, Setup
from .psi import LightMeshes
from .semitransparent import SemitransparentMeshes
from .sharp import sharp
from .sized import SizedLamps


def make(setup: Setup) -> Method:
    """Light meshes with bits at the nodes, or numbers where surfaces let light through; with shares for lamps of SIZE.

    Where shadow paths bend, lamps of SIZE have the shadow of their own shape, in which what bends light is opaque, and
    the refracted paths from their centres.
    """
    count = len(setup.lights)
    sized = mask_of((i for i, light in enumerate(setup.lights) if light.softness == "SIZE"), count)
    if not (sized & union(setup.casters.soft, count)).any():
        return _one_width(setup)
    others = setup._replace(casters=kept(setup.casters, ~sized))
    rest = _one_width(others) if others.casters.soft else sharp(others, others.casters.whole)
    return SizedLamps(setup._replace(casters=kept(setup.casters, sized)), rest)


def _one_width(setup: Setup) -> LightMeshes:
    """Return light meshes whose nodes hold bits, or numbers if surfaces let light through."""
    assert setup.lattice is not None
    return (SemitransparentMeshes if setup.through.channels else LightMeshes)(setup, setup.lattice)


KIND = Kind(make, soft=True, lattice=True, bends=True, counts=True)
