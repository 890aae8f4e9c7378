"""Measure what a camera flight over a static scene saves if nodes are kept: python tests/support/flight.py [frames]
[width].

For 1, 16 and 64 lights it prints the time of the shadow stages (thread seconds) of the flight, the time of the same
frames rendered one by one, and their ratio, and whether the pictures are the same. It is run by hand, because times are
no test.
"""

import sys
from dataclasses import replace

import numpy as np
from light_meshes import Camera
from light_meshes.film.images import Framebuffer
from light_meshes.picture.render import draw, prepare
from scenes import hall

SHADOWS = ("candidates", "nodes", "uniform skip", "short rays", "average", "sharp shadows")


def flight(lights: int, frames: int, width: int, **values) -> None:
    scene = hall(lights, columns=8, sides=40, **values)
    kept, stages = None, {name: np.zeros(2) for name in SHADOWS}
    rays, equal = np.zeros(2, int), True
    for n in range(frames):
        turn = 0.02 * n
        eye = (3.6 * np.cos(turn) + 4.6 * np.sin(turn), 3.6 * np.sin(turn) - 4.6 * np.cos(turn), 3.6 - turn)
        scene = replace(scene, camera=Camera.look_at(eye, (0, 0, 0.3), 45, width, width * 9 // 16))
        pictures = []
        for i, previous in enumerate((kept, None)):
            ready = prepare(scene, ("Combined",), previous=previous)
            done = draw(ready, Framebuffer.create(scene, ("Combined",)))
            for name in SHADOWS:
                stages[name][i] += done.statistics["stages"].get(name, 0)
            rays[i] += done.statistics["long_rays"]
            pictures.append(done.passes["Combined"])
            kept = ready if i == 0 else kept
        equal &= np.array_equal(*pictures)
    total = sum(stages.values())
    print(f"{lights} lights, {frames} frames of {width} pixels, h = {scene.settings.h}, kI = {scene.settings.kI}: "
          f"{total[0]:.2f} s of {total[1]:.2f} s = {total[0] / total[1]:.2f}; long rays {rays[0]:,} of {rays[1]:,}; "
          f"{'the same pictures' if equal else 'OTHER PICTURES'}")
    print("   ", ", ".join(f"{name} {a:.2f} of {b:.2f}" for name, (a, b) in stages.items()), flush=True)


if __name__ == "__main__":
    frames, width = (int(a) for a in (*sys.argv[1:], *("20", "480")[len(sys.argv) - 1:]))
    for lights in (1, 16, 64):
        flight(lights, frames, width, kI=2.0, h=0.02)
