"""Make the README's pictures from the .blend files: `python blend_scenes/pictures.py [name …]`.

Every part goes through the command line, so through Blender, the add-on and the engine.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import OpenImageIO as oiio

HERE = Path(__file__).parent
GAP = 4  # pixels between two pictures, white


def rendered(folder, scene, **settings):
    """The picture of blend_scenes/SCENE.blend with some settings changed."""
    path = folder / f"{scene} {' '.join(f'{k}={v}' for k, v in settings.items())}.png"
    command = [sys.executable, "-m", "light_meshes.cli", "render", str(HERE / f"{scene}.blend"), "-o", str(path)]
    subprocess.run(command + [word for k, v in settings.items() for word in ("--set", f"{k}={v}")], check=True)
    picture = oiio.ImageBuf(str(path))
    return oiio.ImageBufAlgo.channels(picture, (0, 1, 2))


def side_by_side(rows):
    """Pictures of one size as a table, with a thin white line between them."""
    width, height = rows[0][0].spec().width, rows[0][0].spec().height
    table = oiio.ImageBuf(oiio.ImageSpec(len(rows[0]) * (width + GAP) - GAP, len(rows) * (height + GAP) - GAP, 3,
                                         oiio.UINT8))
    oiio.ImageBufAlgo.fill(table, (1.0, 1.0, 1.0))
    for y, row in enumerate(rows):
        for x, picture in enumerate(row):
            oiio.ImageBufAlgo.paste(table, x * (width + GAP), y * (height + GAP), 0, 0, picture)
    return table


def tabletop(folder):
    """Fig. 3: RRTA left, light meshes right."""
    size = {"resolution": "700x700"}
    return side_by_side([[rendered(folder, "tabletop", shadows="SHARP", **size), rendered(folder, "tabletop", **size)]])


def parameters(folder):
    """Fig. 6, bottom up: h falls at r = .15 in the left column, r grows at h = .05 in the right one."""
    left = [(h, 0.15) for h in (0.1, 0.075, 0.05, 0.0375)]
    right = [(0.05, r) for r in (0.075, 0.1, 0.15, 0.2)]
    rows = zip(reversed(left), reversed(right), strict=True)
    return side_by_side([[rendered(folder, "parameters", h=h, kI=round(r / h, 6)) for h, r in row] for row in rows])


def cylinder(folder):
    """Fig. 4: RRTA above, light meshes below; no refraction, refraction of view rays, of shadow rays too."""
    return side_by_side([[rendered(folder, "cylinder", shadows=shadows, refraction=refraction, resolution="480x480")
                          for refraction in ("NONE", "VIEW", "FULL")] for shadows in ("SHARP", "LIGHT_MESHES")])


def lens(folder):
    """Fig. 5: RRTA left, light meshes right."""
    return side_by_side([[rendered(folder, "lens", shadows=shadows, resolution="700x700")
                          for shadows in ("SHARP", "LIGHT_MESHES")]])


PICTURES = {"tabletop": tabletop, "parameters": parameters, "cylinder": cylinder, "lens": lens}

if __name__ == "__main__":
    for name in sys.argv[1:] or PICTURES:
        with tempfile.TemporaryDirectory() as folder:
            picture = PICTURES[name](Path(folder))
        if not picture.write(str(HERE / f"{name}.png")):
            sys.exit(picture.geterror())
        print(f"{name}.png: {(HERE / f'{name}.png').stat().st_size / 1000:.0f} kB")
