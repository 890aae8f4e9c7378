"""Make the documentation's pictures from the .blend files: `python blend_scenes/pictures.py [name …]`.

Pictures that differ only in settings go through the command line, so through Blender, the add-on and the engine.
Changes to a light, an object or a material are made in the snapshot that the add-on exports. Cycles renders the same
.blend. `panels` needs a Blender with a window (LIGHT_MESHES_BLENDER, or on the PATH), Xvfb and ImageMagick.
"""

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from light_meshes.film.images import to_srgb
from light_meshes.frontends import blend
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.description import Light

HERE = Path(__file__).parent
PICTURES_FOLDER = HERE.parent / "docs" / "pictures"
GAP = 4  # pixels between two pictures, white
CYCLES_SAMPLES = 128


def rendered(folder, scene, **settings):
    """Return the picture of blend_scenes/SCENE.blend with some settings changed."""
    path = folder / f"{scene} {' '.join(f'{k}={v}' for k, v in settings.items())}.png"
    command = [sys.executable, "-m", "light_meshes.cli", "render", str(HERE / f"{scene}.blend"), "-o", str(path)]
    subprocess.run(command + [word for k, v in settings.items() for word in ("--set", f"{k}={v}")], check=True)
    picture = oiio.ImageBuf(str(path))
    return oiio.ImageBufAlgo.channels(picture, (0, 1, 2))


def exported(folder, scene, **settings):
    """Return blend_scenes/SCENE.blend as the add-on exports it for the engine."""
    blend.export(HERE / f"{scene}.blend", folder / scene, [(k, str(v)) for k, v in settings.items()], False)
    return snapshot.read(folder / scene)


def drawn(scene):
    """Render an exported scene, and return the picture as Blender's view transform "Standard" shows it."""
    return picture_of(render_image(scene).passes["Combined"])


def picture_of(pixels):
    """Convert scene-linear pixels (h,w,3 or 4), bottom row first, to a picture."""
    pixels = np.dstack([pixels[::-1, :, :3], np.ones(pixels.shape[:2])]).astype(np.float32)
    return oiio.ImageBuf(np.ascontiguousarray(to_srgb(pixels)[..., :3]))


def altered(things, **by_name):
    """Return lights, objects or materials with some properties changed: NAME={property: value}, with _ in place of a
    space.
    """
    names = {name.replace("_", " "): values for name, values in by_name.items()}
    return tuple(replace(thing, **names.get(thing.name, {})) for thing in things)


def by_cycles(folder, scene, size, **radii):
    """Return Cycles' direct light on blend_scenes/SCENE.blend with lamps of these radii (None: the radius in the
    file).
    """
    path = folder / "cycles.exr"
    request = {"file": str(HERE / f"{scene}.blend"), "lights": radii, "power": 1.0, "width": size[0],
               "height": size[1], "samples": CYCLES_SAMPLES, "seed": 0, "picture": str(path)}
    subprocess.run([sys.executable, str(HERE / "direct_light.py")], input=json.dumps(request) + "\n", text=True,
                   check=True, capture_output=True)
    return picture_of(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[::-1])


def side_by_side(rows):
    """Arrange pictures of one size as a table, with thin white lines between them."""
    width, height = rows[0][0].spec().width, rows[0][0].spec().height
    table = oiio.ImageBuf(oiio.ImageSpec(len(rows[0]) * (width + GAP) - GAP, len(rows) * (height + GAP) - GAP, 3,
                                         oiio.UINT8))
    oiio.ImageBufAlgo.fill(table, (1.0, 1.0, 1.0))
    for y, row in enumerate(rows):
        for x, picture in enumerate(row):
            oiio.ImageBufAlgo.paste(table, x * (width + GAP), y * (height + GAP), 0, 0, picture)
    return table


def tabletop(folder):
    """Fig. 3: RRTA on the left, light meshes on the right."""
    size = {"resolution": "700x700"}
    return side_by_side([[rendered(folder, "tabletop", shadows="SHARP", **size), rendered(folder, "tabletop", **size)]])


def parameters(folder):
    """Fig. 6, from the bottom up: in the left column h falls at r = .15, in the right column r grows at h = .05."""
    left = [(h, 0.15) for h in (0.1, 0.075, 0.05, 0.0375)]
    right = [(0.05, r) for r in (0.075, 0.1, 0.15, 0.2)]
    rows = zip(reversed(left), reversed(right), strict=True)
    return side_by_side([[rendered(folder, "parameters", h=h, kI=round(r / h, 6)) for h, r in row] for row in rows])


def weights(folder):
    """kI = 1.5, 2, 3, 4 from left to right at the same r; above with uniform weights, below with smooth ones."""
    return side_by_side([[rendered(folder, "parameters", h=0.15 / kI, kI=kI, weights=weights, resolution="1000x1000")
                          for kI in (1.5, 2.0, 3.0, 4.0)] for weights in ("UNIFORM", "SMOOTH")])


def cylinder(folder):
    """Fig. 4: RRTA above, light meshes below; no refraction, refraction of view rays, and of shadow rays too."""
    return side_by_side([[rendered(folder, "cylinder", shadows=shadows, refraction=refraction, resolution="480x480")
                          for refraction in ("NONE", "VIEW", "FULL")] for shadows in ("SHARP", "LIGHT_MESHES")])


def lens(folder):
    """Fig. 5: RRTA on the left, light meshes on the right."""
    return side_by_side([[rendered(folder, "lens", shadows=shadows, resolution="700x700")
                          for shadows in ("SHARP", "LIGHT_MESHES")]])


def control(folder):
    """Four pictures: all shadows soft; one of the two lights sharp; the bar casts sharp shadows; the cylinder receives
    sharp ones.
    """
    scene = exported(folder, "tabletop", resolution="480x480", h=0.04, kI=4)
    second = Light("Second", "POINT", (9.0, 10.0, 12.0), position=(-2.6, -2.2, 3.2))
    scene = replace(scene, lights=(replace(scene.lights[0], intensity=(10.0, 9.5, 9.0)), second))
    return side_by_side([
        [drawn(scene), drawn(replace(scene, lights=altered(scene.lights, Second={"soft_shadows": False})))],
        [drawn(replace(scene, objects=altered(scene.objects, Bar={"cast_soft_shadows": False}))),
         drawn(replace(scene, objects=altered(scene.objects, Cylinder={"receive_soft_shadows": False})))],
    ])


def light_size(folder):
    """Lamps of radius .1, .3, .6. Above: light meshes with Light Size and the same number of nodes in each edge. Below:
    Cycles.
    """
    scene = exported(folder, "limits")
    radii, size = (0.1, 0.3, 0.6), (scene.camera.width, scene.camera.height)
    return side_by_side([
        [drawn(replace(scene, lights=altered(scene.lights, Lamp={"radius": radius}),
                       settings=replace(scene.settings, h=radius * scene.settings.h / 0.3))) for radius in radii],
        [by_cycles(folder, "limits", size, Lamp=radius, Fill=None) for radius in radii],
    ])


def limits(folder):
    """Return the posts with Cycles, with light meshes, and with light meshes and sharp shadows of the three thin posts.
    """
    scene = exported(folder, "limits")
    sharp = {f"Post_{n}": {"cast_soft_shadows": False} for n in (3, 4, 5)}
    return side_by_side([[by_cycles(folder, "limits", (scene.camera.width, scene.camera.height), Lamp=None, Fill=None),
                          drawn(scene), drawn(replace(scene, objects=altered(scene.objects, **sharp)))]])


def panels(folder):
    """Screenshots of the panels of the render properties and of a lamp, from a Blender on a virtual screen."""
    width, height = 640, 900
    reading, writing = os.pipe()
    screen = subprocess.Popen(["Xvfb", "-displayfd", str(writing), "-screen", "0", f"{width}x{height}x24", "-nolisten",
                               "tcp", "+extension", "GLX"], pass_fds=[writing])
    os.close(writing)
    try:
        with os.fdopen(reading) as f:
            display = f":{f.readline().strip()}"
        environment = os.environ | {"DISPLAY": display, "LIBGL_ALWAYS_SOFTWARE": "1"}
        subprocess.run([os.environ.get("LIGHT_MESHES_BLENDER", "blender"), "--factory-startup", "--window-geometry",
                        "0", "0", str(width), str(height), "-P", str(HERE / "panels.py"), "--", str(folder)],
                       env=environment, check=True)
    finally:
        screen.terminate()
        screen.wait()
    shots = [oiio.ImageBuf(str(folder / f"{name}.png")) for name in ("render", "light")]
    return side_by_side([[oiio.ImageBufAlgo.cut(oiio.ImageBufAlgo.channels(shot, (0, 1, 2)),
                                                oiio.ROI(0, width, 0, 705)) for shot in shots]])


def materials(folder):
    """Balls with procedural materials. Above: this engine. Below: Cycles."""
    return beside_cycles(folder, "materials")


def lamp_nodes(folder):
    """Lamps with nodes. Above: this engine. Below: Cycles."""
    return beside_cycles(folder, "lamp_nodes")


def shapes(folder):
    """Things under lamps with a size. Above: this engine. Below: Cycles."""
    return beside_cycles(folder, "shapes")


def window(folder):
    """Return a room with a window, with bounced light. Above: this engine. Below: Cycles."""
    return beside_cycles(folder, "window")


def equal_time(folder):
    """Return the contest's hall at night. Above: this engine. Below: Cycles with its denoiser, in equal time."""
    return beside_cycles(folder, "equal_time")


def beside_cycles(folder, script):
    """Run blend_scenes/SCRIPT.py, which renders with both engines; return its pictures, one above the other."""
    subprocess.run([sys.executable, str(HERE / f"{script}.py"), str(folder)], check=True)
    return side_by_side([[oiio.ImageBufAlgo.channels(oiio.ImageBuf(str(folder / f"{engine}.png")), (0, 1, 2))]
                         for engine in ("LIGHT_MESHES", "CYCLES")])


PICTURES = {f.__name__: f for f in (tabletop, parameters, weights, cylinder, lens, control, light_size, limits,
                                   materials, lamp_nodes, shapes, window, equal_time, panels)}

if __name__ == "__main__":
    PICTURES_FOLDER.mkdir(exist_ok=True)
    for name in sys.argv[1:] or PICTURES:
        with tempfile.TemporaryDirectory() as folder:
            picture = PICTURES[name](Path(folder))
        path = PICTURES_FOLDER / f"{name.replace('_', '-')}.jpg"
        picture.specmod().attribute("Compression", "jpeg:90")
        picture.specmod().attribute("jpeg:subsampling", "4:4:4")
        if not picture.write(str(path)):
            sys.exit(picture.geterror())
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")
