"""The contest's hall at night by both engines in equal time: `python blend_scenes/equal_time.py FOLDER`.

This engine renders with *Balanced*. Then Cycles renders, with the same bounces and its denoiser, as many samples as it
can in the seconds that this took. The pictures become docs/pictures/equal-time.jpg (see pictures.py).
"""

import os
import sys
import time
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent / "contest"))

import cell
import night_hall

SIZE = 832, 468
FRAME = 10


def render(engine, path):
    """Render the open scene into a file, and return the seconds that it takes."""
    scene = bpy.context.scene
    cell.prepare(scene, {"engine": engine, "width": SIZE[0], "height": SIZE[1], "threads": os.cpu_count(),
                         "frames": [FRAME], "reference": False, "level": 'BALANCED', "denoise": True, "samples": 4096})
    scene.frame_set(FRAME)
    scene.render.image_settings.file_format, scene.render.filepath = 'PNG', str(path)
    began = time.perf_counter()
    bpy.ops.render.render(write_still=True)
    return time.perf_counter() - began


def make(folder):
    """Render the hall with both engines into FOLDER/ENGINE.png."""
    night_hall.make(folder)
    seconds = render('LIGHT_MESHES', folder / "LIGHT_MESHES.png")
    bpy.context.scene.cycles.time_limit = seconds
    cycles = render('CYCLES', folder / "CYCLES.png")
    print(f"Light Meshes: {seconds:.1f} s; Cycles, samples for so long, and then its denoiser: {cycles:.1f} s")


if __name__ == "__main__":
    make(Path(sys.argv[1]))
