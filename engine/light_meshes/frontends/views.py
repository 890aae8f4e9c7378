"""The pictures of a 3D view, each better than the one before, and the data that a view keeps between them.

Where all light is expected to take longer than an artist likes to wait, pictures with only direct light come first
(`picture/first.py`), and pictures with all light follow. The expectation is a measured time: that of the first picture
with all light of the same view before.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from ..film.images import Framebuffer
from ..picture import first, render
from ..picture.catchers import Alone
from ..picture.everywhere import Everywhere
from ..picture.measured import Measured
from ..picture.prepared import Before, Prepared
from ..picture.shadowing import Shadowing
from ..picture.world import World
from ..rays.camera import coarser
from ..scene.description import Camera, Scene

QUICK = 0.3  # seconds: if a whole picture at the coarsest resolution takes no longer, it is the first one
LATER = 1.0  # seconds: a picture of direct light is made finer if this takes no longer
TILE = 64  # pixels along a side of a tile in pictures of direct light: they are small, and each tile costs its calls
FINE = 2  # after pictures of direct light, those with all light begin with this divisor or the last one


@dataclass
class Parts:
    """The parts that the next picture may take over; see `Before`."""

    world: World
    measured: Measured
    shadowing: Shadowing
    everywhere: Everywhere | None
    alone: Alone | None


@dataclass
class Kept:
    """The data that a view keeps for its next picture."""

    whole: Prepared | None = None  # for the last picture with all light
    direct: Prepared | None = None  # for the last picture of direct light, if there was none with all light since
    scene: Scene | None = None  # of the last view
    took: dict[bool, float] = field(default_factory=dict)  # seconds of a whole picture: of the same scene, of another

    @property
    def before(self) -> Before | None:
        """Return the newest of each part."""
        if self.direct is None or self.whole is None:
            return self.direct or self.whole
        return Parts(self.direct.world, self.direct.measured, self.whole.shadowing, self.whole.everywhere,
                     self.whole.alone)


def pictures(kept: Kept, scene: Scene, camera: Camera | None, steps: Sequence[tuple[int, int]], passes: Sequence[str],
             direct: bool, cancelled: Callable[[], bool], progress: render.Progress) -> Iterator[render.Result]:
    """Yield the pictures of a view in these steps of (divisor of the resolution, samples per pixel).

    camera: the camera of the rays; None: the scene's. direct: pictures of direct light may come first. Then some steps
    may be left out, but not the last one.
    """
    view, same = camera or scene.camera, kept.scene is scene
    kept.scene = scene
    last = 0  # divisor of the last picture of direct light
    if direct and first.lacks(scene, view) and kept.took.get(same, QUICK) >= QUICK:
        for divisor, done in _direct(kept, scene, view, passes, cancelled):
            yield done
            last = divisor
    if last:
        steps = [step for n, step in enumerate(steps) if step[0] <= max(last, FINE) or n == len(steps) - 1]
    for n, (divisor, samples) in enumerate(steps):
        began = time.monotonic()
        try:
            kept.whole = ready = render.prepare(
                replace(scene, settings=replace(scene.settings, samples=samples)), passes, cancelled, kept.before,
                coarser(view, divisor), progress=progress)
            kept.direct = None
            done = render.draw(ready, Framebuffer.create(ready.scene, passes), cancelled=cancelled, progress=progress)
        except render.Cancelled:
            if n == 0 and time.monotonic() - began > QUICK:
                kept.took[same] = time.monotonic() - began
            raise
        if n == 0:  # a finer one takes longer, at least by what preparing does not take
            kept.took[same] = (time.monotonic() - began) * min(1.0, divisor / first.COARSE)
        yield done


def _direct(kept: Kept, scene: Scene, camera: Camera, passes: Sequence[str],
            cancelled: Callable[[], bool]) -> Iterator[tuple[int, render.Result]]:
    """Yield pictures of direct light, each twice as fine as the one before, with their divisors."""
    divisor = first.divisor(scene, camera)
    quick = first.direct(scene, camera, divisor, first.PAIRS)
    while True:
        ready = render.prepare(quick, passes, cancelled, kept.before, coarser(camera, divisor), quick=True)
        kept.direct = ready
        began = time.monotonic()
        tile = TILE * (2 if ready.plan.transparent else 1)  # cut-outs take many waves of rays, each with its calls
        done = render.draw(ready, Framebuffer.create(ready.scene, passes), tile_size=tile, cancelled=cancelled)
        took = time.monotonic() - began
        yield divisor, done
        if divisor == 1:
            return
        divisor //= 2
        lamps = max(1, len(quick.lights))
        quick = first.direct(scene, camera, divisor, first.LATER_PAIRS)
        if took * 4 * len(quick.lights) / lamps > LATER:
            return
