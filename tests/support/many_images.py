"""How much memory many large images take: python tests/support/many_images.py [IMAGES] [SIDE] [LIMIT in MiB].

Renders as many squares (200), each with an image of its own of SIDE² texels (4096), and prints the peak of the memory
of the process, and how long it took. The images are one JPEG under many names.
"""

import resource
import shutil
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from light_meshes import Scene, Shape, rectangle
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Image, Material
from light_meshes.surface import textures

sys.path.insert(0, str(Path(__file__).parent))
from scenes import look_down, settings


def picture(side):
    """Return a JPEG of noise in squares."""
    small = np.random.default_rng(1).integers(0, 256, (side // 16, side // 16, 3), np.uint8)
    return oiio.ImageBuf(np.repeat(np.repeat(small, 16, axis=0), 16, axis=1))


def scene(files, pixels):
    n = int(np.ceil(np.sqrt(len(files))))
    shapes = []
    for i in range(len(files)):
        x, y = i % n / n - 0.5, i // n / n - 0.5
        shapes.append(Shape(rectangle((x, y), (x + 1 / n, y + 1 / n), 0.0), Material(f"{i}", kd=0.0, image=i), f"{i}"))
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    uvs = np.concatenate([corners[shape.mesh.triangles] for shape in shapes])
    made = Scene.from_shapes(shapes, look_down(0, 0, 1, pixels), [], settings(), world_color=(1.0, 1.0, 1.0),
                             images=tuple(Image(f"{i}", str(file)) for i, file in enumerate(files)))
    return replace(made, geometry=replace(made.geometry, uvs=uvs))


def main(count=200, side=4096, limit=0):
    textures.LIMIT = limit << 20 if limit else textures.LIMIT
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{i}.jpg" for i in range(count)]
        if not picture(side).write(str(files[0])):
            sys.exit("the image cannot be written")
        for file in files[1:]:
            shutil.copyfile(files[0], file)
        before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
        render_image(scene(files, 400))
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(f"{count} images of {side}² texels, {count * side**2 * 3 / 2**20:,.0f} MiB; limit "
              f"{textures.LIMIT >> 20:,} MiB: peak {after / 1024:,.0f} MiB "
              f"({before / 1024:,.0f} before), {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
