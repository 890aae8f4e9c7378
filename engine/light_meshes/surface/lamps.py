"""Programs of lamps: by how much their nodes change the light of each lamp at each receiver.

They run for batches of pairs of a receiver and a lamp that lights it. Some programs have the same operations, and only
their numbers, images and profiles differ, for example those of the spots of a stage. They run as one program over the
pairs of all of them. If no lamp has a program, nothing is computed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lights.registry import KINDS
from ..scene.description import Camera, Light, Scene
from ..scene.programs import CHOICES, OF_LIGHT, Operation, Program
from ..support.bits import mask_of
from .faces import Faces
from .profiles import Lookup
from .programs import run
from .sources import CELLS, FEW, Sources, Spaces, balls, met, suns, toward
from .textures import Texture

PAIRS = 1 << 15  # that are evaluated at once
# What differs over the part of a sphere that a receiver sees.
OVER_BALLS = {"normal", "true_normal", "object_normal", "position", "object", "generated", "uv", "parametric"}
BY_RECEIVER = {"incoming", "ray_length"}  # what differs from receiver to receiver at one point of a face
# Arguments that must be the same in programs that run as one, beside those of CHOICES; and those of CHOICES that need
# not.
_SAME = {"brick": (0, 2)}
_FREE = {("image", 0), ("ies", 0)}
# What of a lamp that is asked in its middle is as smooth as its light: the distance, and arithmetic with it.
_SMOOTH = {"ray_length", "add", "subtract", "multiply", "divide", "power", "sqrt"}


class Group(NamedTuple):
    """Lamps whose programs run as one."""

    lamps: NDArray[np.int64]
    program: Program  # an array (L,) stands for a number that differs
    type: str
    fixed: bool  # it asks nothing of BY_RECEIVER
    ball: bool  # they are spheres, and it asks for what is in OVER_BALLS


class Lamps:
    """The programs of a scene's lamps, ready to be run."""

    def __init__(self, scene: Scene, textures: Sequence[Texture | None], camera: Camera) -> None:
        lights, self._textures = scene.lights, textures
        self.any = any(light.program for light in lights)
        self.varied = mask_of([i for i, light in enumerate(lights) if _varies(light)], len(lights))  # (W,)
        if not self.any:
            return
        self._spaces = Spaces(lights, camera, [Lookup(profile) for profile in scene.profiles])
        self._faces = Faces(lights, self._spaces)
        groups = list(_groups(lights))
        self._suns = np.ones((len(lights), 3), np.float32)  # of lamps that are the same for all receivers
        for group in groups:
            if KINDS[group.type].directional:
                travels = np.array([lights[i].direction for i in group.lamps], np.float64)
                travels /= np.maximum(np.linalg.norm(travels, axis=1, keepdims=True), 1e-300)
                self._suns[group.lamps] = self._run(group, suns(self._spaces, group.lamps, travels))
        self._groups = [group for group in groups if not KINDS[group.type].directional]
        self._plain = np.setdiff1d(np.arange(len(lights)), [i for group in self._groups for i in group.lamps])

    def __call__(self, P: NDArray[np.float64], N: NDArray[np.float64],
                 S: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return S (n,L,C) of receivers at P with normals N, both (n,3), multiplied by the colours that the lamps'
        nodes give; C becomes 3.
        """
        if not self.any:
            return S
        out = np.zeros((*S.shape[:2], 3), np.float32)
        out[:, self._plain] = S[:, self._plain] * self._suns[self._plain]
        lit = S[:, :, 0] != 0 if S.shape[2] == 1 else S.any(2)
        for group in self._groups:
            row, which = np.nonzero(lit if len(group.lamps) == len(lit[0]) else lit[:, group.lamps])
            for first in range(0, len(row), PAIRS):
                part = row[first:first + PAIRS]
                lamp = group.lamps[which[first:first + PAIRS]]
                out[part, lamp] = S[part, lamp] * self._light(group, lamp, P[part], N[part]).astype(np.float32)
        return out

    def seen(self, i: int, origin: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the colours (n,3) that the nodes of lamp i give for rays that see it, from origin along unit
        direction, both (n,3).
        """
        group = next((group for group in self._groups if i in group.lamps), None)
        if group is None:
            return np.tile(self._suns[i].astype(np.float64), (len(origin), 1))
        lamp = np.full(len(origin), i, np.int64)
        return self._run(group, self._faces.met(lamp, origin, direction) if group.type == "AREA"
                         else met(self._spaces, lamp, origin, direction))

    def _light(self, group: Group, lamp: NDArray[np.int64], P: NDArray[np.float64],
               N: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the colours (n,3) that the nodes of lamps (n,) give for receivers."""
        if group.type == "AREA":
            return self._faces.mean(lambda points: self._run(group, points), group.fixed, lamp, P, N)
        if group.ball:
            light = self._run(group, balls(self._spaces, lamp, P)).reshape(len(lamp), CELLS * CELLS, 3)
            return np.einsum("k,nkj->nj", FEW.area.ravel(), light)
        return self._run(group, toward(self._spaces, lamp, P))

    def _run(self, group: Group, points: Sources) -> NDArray[np.float64]:
        found: Any = points
        return run(group.program, found, self._textures, OF_LIGHT)["emission"]


def _varies(light: Light) -> bool:
    """Return whether the nodes of a lamp may change its light with the direction, or abruptly."""
    return bool(light.program) and not (KINDS[light.type].directional or light.program.asks() <= _SMOOTH)


def _groups(lights: Sequence[Light]) -> Iterator[Group]:
    """Return the lamps that have programs, in groups of those that run as one."""
    alike: dict[tuple, list[int]] = {}
    for i, light in enumerate(lights):
        if light.program:
            alike.setdefault((light.type, _ball(light), *_structure(light.program)), []).append(i)
    for (_, ball, *_), lamps in alike.items():
        programs = [lights[i].program for i in lamps]
        made = _joined(programs, np.array(lamps), len(lights))
        yield Group(np.array(lamps), made, lights[lamps[0]].type, not BY_RECEIVER & made.asks(), ball)


def _ball(light: Light) -> bool:
    """Return whether the program is run as a mean over the lamp's sphere, because it asks what differs over it. The UV
    of a spot depends on the direction only, and needs no mean.
    """
    over = OVER_BALLS - ({"uv", "parametric"} if light.type == "SPOT" else set())
    return (light.type in ("POINT", "SPOT") and light.radius > 0 and not light.facing_disc
            and bool(light.program.asks() & over))


def _structure(program: Program) -> Iterator[Any]:
    """Return the parts of programs that must be equal if they run as one: everything but numbers, images and profiles.
    """
    for o in program.operations:
        fixed = {place for place, *_ in CHOICES.get(o.name, ())}.union(_SAME.get(o.name, ()))
        yield o.name, *(a if isinstance(a, tuple) or (k in fixed and (o.name, k) not in _FREE) else None
                        for k, a in enumerate(o.arguments))
    yield tuple(a if isinstance(a, tuple) else None for a in program.values["emission"])


def _joined(programs: Sequence[Program], lamps: NDArray[np.int64], count: int) -> Program:
    """Return programs of one structure as one program, in which an array (count,) stands for a number that differs."""
    def one(arguments: tuple[Any, ...]) -> Any:
        if all(a == arguments[0] for a in arguments):
            return arguments[0]
        column = np.zeros(count)
        column[lamps] = arguments
        return column

    operations = tuple(Operation(o.name, tuple(one(a) for a in zip(*(p.operations[k].arguments for p in programs),
                                                                   strict=True)))
                       for k, o in enumerate(programs[0].operations))
    emission = tuple(one(a) for a in zip(*(p.values["emission"] for p in programs), strict=True))
    return Program(operations, {"emission": emission})
