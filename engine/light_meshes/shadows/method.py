"""The contract of shadow methods, which say how much of each light receivers see: S_i(P).

A method is a class in a file of its own, which also has the method's `KIND`: its name, what it can do, the settings
that it has for itself, and the function that makes it from the `Setup` of a scene. `registry` lists all kinds. Plan,
validation and messages read there what they need to know, and nobody else asks of what class a method is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..glass.refraction import RefractedPaths
from ..rays.geometry import Surfaces
from ..rays.tracer import Targets, Tracer
from ..scene.description import Light, Scalar, Settings
from ..scene.values import checked_mapping
from ..support.statistics import Statistics
from .casters import Casters
from .meshes.averaging import Classes
from .meshes.certificate import Certificate
from .meshes.lattice import Lattice
from .meshes.node_store import NodeStore
from .meshes.path_table import PathTable
from .terminator import Lift

Check = Callable[[], None]  # raises where the render was cancelled
Factor = Callable[[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]


class Receivers(NamedTuple):
    """A batch of points that are lit, and the lights that each is asked about."""

    P: NDArray[np.float64]  # (n,3) world
    N: NDArray[np.float64] | None  # (n,3) unit geometric normals on the viewed side; None: points in free space
    active: NDArray[np.uint64]  # (n,W) bits: light i of receiver p is asked for, which is where ξ_i·Ω_i ≠ 0
    triangle: NDArray[np.int32] | None = None  # (n,) that P is on; None: on surfaces that soft shadows fall on
    lift: Lift | None = None  # where light grazes smooth surfaces, rays start above their facets; None: nowhere

    def normals(self) -> NDArray[np.float64]:
        """N of receivers that are on surfaces."""
        assert self.N is not None, "this method has no answer for points in free space"
        return self.N


class Nodes(Protocol):
    """What methods have that keep values at lattice nodes, which may be right in the next picture, too."""

    lattice: Lattice
    store: NodeStore
    paths: PathTable | None  # refracted paths of all nodes, where they are kept apart

    def take(self, old: Nodes) -> None:
        """Take the nodes of `old` over, which are all right here."""


class Method(Protocol):
    """How much of each light receivers see. Made once a scene; threads share it.

    The answer must not depend on batches, tiles, threads or order.
    """

    nodes: Nodes | None = None  # of kinds with `lattice`

    def __call__(self, at: Receivers, check: Check, probe: NDArray[np.float64] | None = None) -> NDArray[np.float32]:
        """S (n,L,C) float32, 0 where not active; C = 1, or 3 where light comes through coloured glass.

        check: call it between batches of rays. probe (n,4): to be filled with what the debug passes show, in the order
        of `passes.DEBUG`; only kinds that say `counts` are given one.
        """
        ...


class SharpMethod(Method, Protocol):
    """Sharp shadows, which methods with soft ones use for lights without a size and for single rays."""

    def segments(self, P: NDArray, row: NDArray, targets: Targets, target: NDArray, N: NDArray | None, casters: int,
                 triangle: NDArray[np.int32] | None = None) -> NDArray:
        """What gets through (k,C) from P[row] to targets[target], past this set of casters; `triangle`, of each row."""
        ...


class Setting(NamedTuple):
    """A setting that one method has for itself; `Settings.method` holds its value by its name."""

    name: str
    default: Scalar  # its type is the setting's
    low: float = -1e30  # of numbers
    high: float = 1e30
    choices: tuple[str, ...] = ()  # of text; (): any


class Refraction(NamedTuple):
    """How refracted shadow paths are followed."""

    solvers: dict[int, RefractedPaths]  # of each set of casters whose glass bends shadow rays
    footprint: float | None  # FOCUS: radius within which no more light gathers than came in; None: PAPER, Σ Π t
    leak_free: bool


class Through(NamedTuple):
    """What surfaces let through on the way of light."""

    channels: int  # of S: 0 where all are opaque (then S has one, of 0 or 1), 1, or 3 for coloured glass
    factor: Factor  # of crossings: `Interfaces.factor`
    refraction: Refraction | None
    cutouts: bool  # some surfaces have holes


class LatticeSetup(NamedTuple):
    """What kinds with `lattice` are given."""

    lattice: Lattice
    classes: Classes  # of the soft lights, by their radii
    certificate: Certificate | None  # where no short rays are needed
    uniform_skip: bool
    surfaces: Surfaces
    casts: NDArray[np.bool_] | None  # (T,) what shadow rays may meet; None: certificates cost more than they save


class Setup(NamedTuple):
    """What a method is made from."""

    lights: tuple[Light, ...]
    targets: Targets  # where shadow rays go, a row a light
    tracer: Tracer
    stats: Statistics  # counts rays and times stages
    casters: Casters  # which triangles shadow which lights, and which of them softly
    settings: Settings
    own: dict[str, Scalar]  # `Kind.settings`, checked, by their names
    through: Through
    lattice: LatticeSetup | None  # for kinds that ask for it


class Kind(NamedTuple):
    """A method as the registry has it. What it can is said by flags."""

    make: Callable[[Setup], Method]
    soft: bool = False  # soft shadows, of lights and surfaces that the artist lets have them
    lattice: bool = False  # averages lattice nodes: needs h, each light has an r, and nodes are kept between pictures
    bends: bool = False  # follows shadow paths that bend in glass (eq. 6); else they go straight on
    counts: bool = False  # fills the probe of the debug passes
    settings: tuple[Setting, ...] = ()

    def own(self, settings: Settings) -> dict[str, Scalar]:
        """This method's own settings, defaults where none are given. Raises SceneError for names or values it has not.
        """
        given: Mapping[str, Scalar] = settings.method or {}
        return checked_mapping(f"settings: method of {settings.shadows}", given, {s.name: s for s in self.settings})
