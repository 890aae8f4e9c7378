"""What light from everywhere costs, as docs/light.md says it: python tests/support/gathered_cost.py [SNAPSHOT…]

Each SNAPSHOT is a folder that `light-meshes snapshot` wrote; none: two rooms are made, with bpy. Pictures with and
without gathered light are drawn in turns, with all threads, and then a flight: the camera moves a hundredth of its
distance to the side each frame, and what is known of the frame before is taken over. Times are those of processors and
of the clock; the least of each.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from light_meshes.film.images import Framebuffer
from light_meshes.picture import render
from light_meshes.scene.description import Scene
from light_meshes.scene.snapshot import read

ROOT = Path(__file__).resolve().parents[2]
# How the rooms are made: the documentation's room with a window, and one like Cornell's, of the tests beside Cycles.
ROOMS = {"window": f"""
sys.path.insert(0, {str(ROOT / "blend_scenes")!r})
import window
window.make()
""", "box room": f"""
sys.path[:0] = [{str(ROOT / "tests" / "peers")!r}, {str(ROOT / "tests" / "support")!r}]
import blender_fixtures as fixtures, test_everywhere_cycles as scenes
bpy.ops.wm.read_factory_settings(use_empty=True)
def add_mesh(name, vertices, faces, **properties):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    return fixtures.add(mesh, **properties)
scene = bpy.context.scene
scene.camera = fixtures.add(bpy.data.cameras.new("Camera"))
scenes.room(scene, fixtures.add, add_mesh)
"""}


def made(folder: Path) -> list[Path]:
    """Make the rooms, and return their snapshots in this folder."""
    for name, how in ROOMS.items():
        blend = folder / f"{name}.blend"
        save = f"import sys, bpy\n{how}\nbpy.ops.wm.save_as_mainfile(filepath={str(blend)!r})"
        subprocess.run([sys.executable, "-c", save], check=True, stdout=subprocess.DEVNULL)
        subprocess.run([sys.executable, "-P", "-m", "light_meshes_addon.headless", "snapshot", blend, "-f", "1", "-o",
                        folder / name], check=True, stdout=subprocess.DEVNULL)
    return [folder / name for name in ROOMS]


def drawn(scene: Scene, previous=None, samples: int = 1):
    """Returns (processor seconds, seconds), and the scene made ready; the least of several runs."""
    least = np.full(2, np.inf)
    for _ in range(samples):
        began = time.process_time(), time.perf_counter()
        ready = render.prepare(scene, ("Combined",), previous=previous)
        render.draw(ready, Framebuffer.create(scene, ("Combined",)))
        least = np.minimum(least, (time.process_time() - began[0], time.perf_counter() - began[1]))
    return least, ready


def moved(scene: Scene, frame: int) -> Scene:
    """Return the scene with its camera a little to the right."""
    matrix = scene.camera.matrix.copy()
    middle = scene.geometry.vertices.mean(0) if len(scene.geometry.vertices) else np.zeros(3)
    matrix[:3, 3] += 0.01 * frame * np.linalg.norm(middle - matrix[:3, 3]) * matrix[:3, 0]
    return replace(scene, camera=replace(scene.camera, matrix=matrix))


def main() -> None:
    """Measure the snapshots that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("snapshot", type=Path, nargs="*")
    parser.add_argument("--size", type=int, default=1000, help="pixels of each side")
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--bounces", type=int, default=1)
    parser.add_argument("--frames", type=int, default=5, help="of the flight")
    parser.add_argument("--runs", type=int, default=2)
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(a.snapshot or made(Path(folder)), a)


def measure(snapshots: list[Path], a: argparse.Namespace) -> None:
    """Draw the pictures and print what they cost."""
    for folder in snapshots:
        scene = read(folder)
        scene = replace(scene, camera=replace(scene.camera, width=a.size, height=a.size, crop=None),
                        settings=replace(scene.settings, samples=a.samples, bounces=a.bounces))
        plain = replace(scene, settings=replace(scene.settings, bounces=0, world_light="AMBIENT"))
        direct, whole = np.full(2, np.inf), np.full(2, np.inf)
        for _ in range(a.runs):
            direct = np.minimum(direct, drawn(plain)[0])
            one, ready = drawn(scene)
            whole = np.minimum(whole, one)
        flight, records = [], len(ready.lighting.everywhere)
        for frame in range(1, a.frames + 1):
            one, ready = drawn(moved(scene, frame), ready)
            flight.append(one)
        print(f"{folder.name}: {a.size}², {a.samples} samples, {a.bounces} bounces, {records:,} records")
        for name, seconds in (("direct light alone", direct), ("with gathered light", whole),
                              ("the next frames of a flight", np.median(flight, 0) if flight else whole)):
            print(f"  {name:28} processors {seconds[0]:7.2f} s, clock {seconds[1]:7.2f} s, "
                  f"{seconds[0] / direct[0]:5.2f} × direct", flush=True)


if __name__ == "__main__":
    main()
