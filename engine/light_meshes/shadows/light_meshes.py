"""Soft shadows by light meshes, the method of this project: Ψ for opaque surfaces, and eq. (7) where surfaces let light
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
    """Return light meshes whose nodes hold bits, or numbers if surfaces let light through; lamps of softness SIZE have
    nodes with shares.

    Where shadow paths bend, lamps of SIZE have the shadow of their own shape, in which surfaces that bend light are
    opaque, and the refracted paths from their centres.
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
