"""Measure memory and time of scenes as large as in productions: python tests/support/load.py [scene …]

Each scene is made as a .blend and rendered through Blender. For each scene it prints a row in MiB and seconds: the
memory of the nodes; the largest memory of Blender and of the engine, and the memory that the engine expected; the time
of the engine, and the total time with Blender's start and the export. `small` is a quick check. It is run by hand,
because times are no test.
"""

import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from light_meshes.frontends import blend

MAKE = """
import sys
import bpy, light_meshes_addon
from light_meshes_addon.headless import leave
sys.path.insert(0, {tests!r})
light_meshes_addon.register()
import load
load.make(bpy, *{values!r})
bpy.ops.wm.save_as_mainfile(filepath={path!r}, compress=False)
leave(0)
"""
# name → triangles per object, objects, whether they share a mesh, lights, lines of the picture, samples, h (0:
# automatic)
SCENES = {
    "small": (2_000, 50, False, 4, 135, 1, 0),
    "triangles": (10_000, 200, False, 64, 1080, 4, 0),
    "instances": (2_000, 1_000, True, 16, 1080, 4, 0),
    "lights": (2_000, 100, True, 4_096, 540, 1, 0.05),
}


def make(bpy, triangles, things, shared, lights, height, samples, h):
    """Make a hall with a floor and two walls, full of lumpy balls, under point lights."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = 'LIGHT_MESHES'
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
    scene.render.resolution_x, scene.render.resolution_y = height * 16 // 9, height
    scene.light_meshes.auto_h, scene.light_meshes.samples = not h, samples
    scene.light_meshes.h = h or 0.1

    def add(name, data, location=(0, 0, 0)):
        made = bpy.data.objects.new(name, data)
        made.location = location
        scene.collection.objects.link(made)
        return made

    def mesh(name, vertices, faces):
        made = bpy.data.meshes.new(name)
        made.vertices.add(len(vertices))
        made.vertices.foreach_set("co", np.asarray(vertices, np.float32).ravel())
        made.loops.add(faces.size)
        made.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
        made.polygons.add(len(faces))
        made.polygons.foreach_set("loop_start", np.arange(0, faces.size, faces.shape[1], dtype=np.int32))
        made.update(calc_edges=True)
        made.validate()
        return made

    floor = [(-2.2, -2.2, 0), (2.2, -2.2, 0), (2.2, 2.2, 0), (-2.2, 2.2, 0), (-2.2, -2.2, 2), (-2.2, 2.2, 2),
             (2.2, 2.2, 2)]
    add("Hall", mesh("Hall", floor, np.array([(0, 1, 2, 3), (0, 3, 5, 4), (3, 2, 6, 5)])))
    side = int(np.ceil(np.sqrt(things)))
    step = 4.0 / side
    sides = int(np.sqrt(triangles))
    rings = sides // 2
    u, v = np.meshgrid(np.arange(sides), np.arange(rings))
    a, b = (v * sides + u).ravel(), (v * sides + (u + 1) % sides).ravel()
    faces = np.stack([a, b, b + sides, a + sides], 1)
    random = np.random.default_rng(1)
    turn, rise = np.meshgrid(2 * np.pi * np.arange(sides) / sides, np.linspace(0.05, np.pi - 0.05, rings + 1))
    ball = None
    for n in range(things):
        if ball is None or not shared:
            lumps = 1 + 0.1 * np.sin(random.integers(2, 7) * turn + random.uniform(0, 6)) * np.sin(rise)
            points = [lumps * np.sin(rise) * np.cos(turn), lumps * np.sin(rise) * np.sin(turn), -np.cos(rise)]
            ball = mesh(f"Ball.{n}", 0.35 * step * np.stack([p.ravel() for p in points], 1), faces)
        add(f"Ball.{n}", ball, (step * (n % side + 0.5) - 2, step * (n // side + 0.5) - 2, 0.4 * step))
    for n in range(lights):
        light = bpy.data.lights.new(f"Light.{n}", 'POINT')
        light.energy, light.light_meshes.softness = 300 / lights, 'SCENE'
        add(f"Light.{n}", light, random.uniform((-1.6, -1.6, 1.9), (1.6, 1.6, 2.5)))
    camera = add("Camera", bpy.data.cameras.new("Camera"), (3.6, -4.6, 3.6))
    camera.rotation_euler = (np.radians(60), 0, np.radians(38))
    scene.camera = camera


def peaks(module: str, found: dict[int, int], over: threading.Event) -> None:
    """Fill `found` with the peak memory of the processes that run a Python module, by process id, until `over` is
    set.
    """
    while not over.wait(0.05):
        for process in Path("/proc").glob("[0-9]*"):
            try:
                if module.encode() in (process / "cmdline").read_bytes().split(b"\0"):
                    status = (process / "status").read_text()
                    found[int(process.name)] = int(status.partition("VmHWM:")[2].split()[0]) * 1024
            except (OSError, IndexError):  # the process has just ended
                continue


def measure(name: str, folder: Path) -> None:
    path = folder / f"{name}.blend"
    code = MAKE.format(tests=str(Path(__file__).parent), values=SCENES[name], path=str(path))
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    found, over = {}, threading.Event()
    watcher = threading.Thread(target=peaks, args=("light_meshes_addon.headless", found, over))
    watcher.start()
    began = time.monotonic()
    try:
        _, _, s = blend.render(path, folder / f"{name}.exr", None, False, None, [], lambda *_: None, False)
    finally:
        over.set()
        watcher.join()
    whole = time.monotonic() - began
    size = f"{s['width']}×{s['height']}×{s['samples']}"
    print(f"{name:<10} {s['triangles']:>10,} {s['instances']:>9,} {s['lights']:>6,} {size:>11} {s['nodes']:>10,} "
          f"{s['node_bytes'] / 2**20:>6,.0f} {max(found.values()) / 2**20:>8,.0f} {s['peak_memory'] / 2**20:>7,.0f} "
          f"{s['memory_expected'] / 2**20:>9,.0f} {s['seconds']:>8.1f} {whole:>8.1f}", flush=True)


if __name__ == "__main__":
    print(f"{'scene':<10} {'triangles':>10} {'instances':>9} {'lights':>6} {'samples':>11} {'nodes':>10} {'MiB':>6} "
          f"{'Blender':>8} {'engine':>7} {'expected':>9} {'engine s':>8} {'whole s':>8}")
    with tempfile.TemporaryDirectory(prefix="light-meshes-load-") as folder:
        for name in sys.argv[1:] or [name for name in SCENES if name != "small"]:
            measure(name, Path(folder))
