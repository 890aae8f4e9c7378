"""What Light Threshold costs and changes with thousands of lamps: python tests/support/many_lamps.py SNAPSHOT [WIDTH]

SNAPSHOT is a folder that `light-meshes snapshot` wrote, of a scene with many lamps, such as the contest's exhibition
(`python blend_scenes/contest/make.py FOLDER exhibition`). Drawn in turns, with one thread, are: every sixteenth lamp,
sixteen times as bright; all lamps; with --exact also all lamps without the threshold, which takes long. Printed are
processor seconds, their ratio, the bound that the statistics tell, and the error.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from light_meshes.film.images import Framebuffer
from light_meshes.picture import render
from light_meshes.scene.description import Scene
from light_meshes.scene.snapshot import read

FEWER = 16


def few(scene: Scene) -> Scene:
    """Every sixteenth lamp, sixteen times as bright."""
    lights = scene.lights[::FEWER]
    power = FEWER * np.array([light.intensity for light in lights])
    return replace(scene, lights=tuple(replace(light, intensity=tuple(p)) for light, p in
                                       zip(lights, power.tolist(), strict=True)))


def drawn(scene: Scene) -> tuple[float, np.ndarray, float]:
    """Returns processor seconds, the picture, and the bound."""
    began = time.process_time()
    ready = render.prepare(scene, ("Combined",))
    result = render.draw(ready, Framebuffer.create(scene, ("Combined",)), threads=1)
    seconds = time.process_time() - began
    return seconds, result.passes["Combined"][..., :3].astype(float), result.statistics.get("light_bound", 0.0)


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("snapshot", type=Path)
    parser.add_argument("width", type=int, nargs="?", default=192)
    parser.add_argument("--threshold", type=float, default=0.01)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--exact", action="store_true")
    asked = parser.parse_args()
    scene = read(asked.snapshot)
    high = round(asked.width * scene.camera.height / scene.camera.width)
    scene = replace(scene, camera=replace(scene.camera, width=asked.width, height=high, crop=None),
                    settings=replace(scene.settings, light_threshold=asked.threshold, fast_reflections=True))
    cases = {"few": few(scene), "all": scene}
    least, found, bound = dict.fromkeys(cases, np.inf), {}, {}
    for _ in range(asked.repeats):
        for name, case in cases.items():
            seconds, found[name], bound[name] = drawn(case)
            least[name] = min(least[name], seconds)
    for name, case in cases.items():
        print(f"{len(case.lights):6,} lamps: {least[name]:7.2f} s, bound {bound[name]:.2%}")
    print(f"ratio {least['all'] / least['few']:.2f}")
    if asked.exact:
        seconds, exact, _ = drawn(replace(scene, settings=replace(scene.settings, light_threshold=0.0)))
        off, mean = np.abs(found["all"] - exact), exact.mean()
        print(f"without the threshold {seconds:.2f} s; mean error {off.mean() / mean:.3%} of the mean, 99 % of the "
              f"pixels within {np.quantile(off.max(2) / np.maximum(exact.max(2), 0.1 * mean), 0.99):.2%}")


if __name__ == "__main__":
    main()
