"""The contract of shadow methods: they compute how much of each light receivers see, S_i(P).

A method is a class in its own file. The file also has the method's `KIND`: its name, its abilities, its own settings,
and the function that makes it from the `Setup` of a scene. `registry` lists all kinds. The plan, the validation and
messages read there what they need to know; no other code tests for the class of a method.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..glass.refraction import RefractedPaths
from ..rays.geometry import Surfaces
from ..rays.tracer import Passing, Targets, Tracer
from ..scene.description import Light, Scalar, Settings
from ..scene.values import checked_mapping
from ..support.rows import taken
from ..support.statistics import Statistics
from .casters import Casters
from .lamp_points import Shapes
from .lifts import Lift
from .meshes.averaging import Classes
from .meshes.certificate import Certificate
from .meshes.lattice import Lattice
from .meshes.node_store import NodeStore
from .meshes.path_table import PathTable

Check = Callable[[], None]  # raises if the render was cancelled


class Facet(NamedTuple):
    """Where on the mesh receivers stand that are lifted above it (`terminator`)."""

    P: NDArray[np.float64]  # (n,3) world
    N: NDArray[np.float64]  # (n,3) unit: the geometric normal there, on the visible side
    triangle: NDArray[np.int32]  # (n,)


class Receivers(NamedTuple):
    """A batch of points that are lit, and the lights that are asked about at each point."""

    P: NDArray[np.float64]  # (n,3) world
    N: NDArray[np.float64] | None  # (n,3) unit geometric normals on the visible side; None for points in free space
    active: NDArray[np.uint64]  # (n,W) bits: light i is asked for at receiver p, which is where ξ_i·Ω_i ≠ 0
    # (n,) triangles on which P is; None: on surfaces that receive soft shadows
    triangle: NDArray[np.int32] | None = None
    lift: Lift | None = None  # where light grazes smooth surfaces, rays start above their facets; None: nowhere
    # (n,W) bits that the method sets of lights whose S may change within less than r; None: nobody wants to know
    narrow: NDArray[np.uint64] | None = None
    apart: NDArray[np.float64] | None = None  # (n,) see `Hits`
    weight: NDArray[np.float32] | None = None  # (n,L) of active lights: what P returns of their light; None: not known
    # (n,) where rough surfaces show P: what of its light counts in the picture, over the light of a usual pixel; 0
    # elsewhere. None: 0 everywhere
    shown: NDArray[np.float64] | None = None
    sample: NDArray[np.int64] | None = None  # (n,2) see `Hits`
    block: NDArray[np.int64] | None = None  # (n,) see `Hits`
    several: NDArray[np.uint64] | None = None  # (n,W) bits of lights that stand for others, too (see `grouped`)
    facet: Facet | None = None  # of receivers that are lifted above the mesh; None: they are on it, or it is not known

    def normals(self) -> NDArray[np.float64]:
        """Return N; only for receivers that are on surfaces."""
        assert self.N is not None, "this method has no answer for points in free space"
        return self.N

    def at(self, rows: NDArray[np.int64]) -> Receivers:
        """Return only these receivers (rows ascending); nothing is copied if they are all. Lift and all
        that follows are left out."""
        if len(rows) == len(self.P):
            return self._replace(lift=None, narrow=None, apart=None, weight=None, shown=None, several=None, sample=None,
                                 block=None)
        P, N, active, triangle = (None if a is None else taken(a, rows) for a in self[:4])
        assert P is not None and active is not None
        facet = None if self.facet is None else Facet._make(taken(a, rows) for a in self.facet)
        return Receivers(P, N, active, triangle, facet=facet)


class Lobes(NamedTuple):
    """What receivers mirror."""

    N: NDArray[np.float64]  # (n,3) unit shading normals
    way: NDArray[np.float64]  # (n,3) unit directions of the eye's rays
    alpha: NDArray[np.float64]  # (n,) the squares of their roughness, 0 where they have no highlights of facets


class Nodes(Protocol):
    """The interface of what keeps values at lattice nodes, which may be valid in the next picture too."""

    lattice: Lattice
    store: NodeStore
    paths: PathTable | None  # the refracted paths of all nodes, if they are stored separately
    points: int  # of a lamp that a value is of; 0: its centre only
    lamps: Shapes | None  # whose points these are

    def take(self, old: Nodes) -> None:
        """Take over the nodes of `old`, which must all be valid here."""


class Method(Protocol):
    """Computes how much of each light receivers see. It is made once for a scene; threads share it.

    The answer must not depend on batches, tiles, threads or order.
    """

    nodes: tuple[Nodes, ...] = ()  # for kinds with the flag `lattice`
    weighs: bool = False  # whether it asks for `Receivers.weight`
    threshold: float = 0.0  # the share of the light that lamps with one shadow give together; 0: each has its own
    lamp_tree: tuple[NDArray[np.int32], NDArray[np.bool_]] | None = None  # of which these are nodes, see `grouped.tree`
    # finds which share of highlights is left, over that of the other light: (n,L,C), None: all is 1
    # None: the method has one share for both
    highlights: Callable[[Receivers, NDArray[np.float32], Lobes, Check], NDArray[np.float32] | None] | None = None

    def __call__(self, at: Receivers, check: Check, probe: NDArray[np.float64] | None = None) -> NDArray[np.float32]:
        """Return S (n,L,C) float32, 0 where not active; C = 1, or 3 if light comes through coloured glass.

        `check` must be called between batches of rays. `probe` (n,4) is filled with the values of the debug passes, in
        the order of `passes.DEBUG`; it is given only to kinds with the flag `counts`.
        """
        ...


class SharpMethod(Method, Protocol):
    """Sharp shadows. Methods with soft shadows also use them, for lights without a size and for single rays."""

    def segments(self, P: NDArray, row: NDArray, targets: Targets, target: NDArray, N: NDArray | None, casters: int,
                 triangle: NDArray[np.int32] | None = None, light: NDArray[np.int32] | None = None) -> NDArray:
        """Return the share of light (k,C) that passes from P[row] to targets[target], past this set of casters;
        `triangle` is that of each row, `light` the lamp to which each segment goes; None: `target` says that.
        """
        ...


class Setting(NamedTuple):
    """A setting that only one method has; `Settings.method` holds its value under its name."""

    name: str
    default: Scalar  # its type is the type of the setting
    low: float = -1e30  # for numbers
    high: float = 1e30
    choices: tuple[str, ...] = ()  # for text; () means any


class Refraction(NamedTuple):
    """How refracted shadow paths are followed."""

    solvers: dict[int, RefractedPaths]  # for each set of casters whose glass bends shadow rays
    footprint: float | None  # FOCUS: radius of a disc that gets no more light than came in; None: PAPER, Σ Π t
    leak_free: bool


class Through(NamedTuple):
    """What surfaces let through on the way of light."""

    channels: int  # of S: 0 if all surfaces are opaque (then S has one channel of 0 or 1), 1, or 3 for coloured glass
    passing: Passing  # of straight rays; light that bodies of glass turn aside is missing where it went straight
    refraction: Refraction | None
    cutouts: bool  # whether some surfaces have holes


class LatticeSetup(NamedTuple):
    """The additional data for kinds with the flag `lattice`."""

    lattice: Lattice
    classes: Classes  # of the soft lights, by their radii
    certificate: Certificate | None  # where no short rays are needed
    uniform_skip: bool
    surfaces: Surfaces
    # makes a certificate for another radius, or takes that of the picture before; None: they cost more than they save
    certify: Callable[[float], Certificate | None] | None


class Setup(NamedTuple):
    """The data from which a method is made."""

    lights: tuple[Light, ...]
    targets: Targets  # where shadow rays go, one row for each light
    tracer: Tracer
    stats: Statistics  # counts rays and measures stages
    casters: Casters  # which triangles cast shadows in which lights, and which of these shadows are soft
    settings: Settings
    own: dict[str, Scalar]  # checked values of `Kind.settings`, by name
    through: Through
    lattice: LatticeSetup | None  # only for kinds that need it


class Kind(NamedTuple):
    """A shadow method in the registry. Flags say what it can do."""

    make: Callable[[Setup], Method]
    soft: bool = False  # it has soft shadows, for lights and surfaces for which the artist allows them
    # it averages lattice nodes: it needs h, each light has an r, and nodes are kept from picture to picture
    lattice: bool = False
    bends: bool = False  # it follows shadow paths that bend in glass (eq. 6); otherwise they go straight
    counts: bool = False  # it fills the probe for the debug passes
    settings: tuple[Setting, ...] = ()

    def own(self, settings: Settings) -> dict[str, Scalar]:
        """Return this method's own settings, with defaults for those that are not given. Raises SceneError for an
        unknown name or a wrong value.
        """
        given: Mapping[str, Scalar] = settings.method or {}
        return checked_mapping(f"settings: method of {settings.shadows}", given, {s.name: s for s in self.settings})
