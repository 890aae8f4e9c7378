"""A type of light is a pair of files, and three lines elsewhere: the recipe of docs/developers.md, followed."""

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes import Scene, Shape, rectangle
from light_meshes.lights import registry
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.description import LIGHT_TYPES
from light_meshes.support import declarations, sources
from recipes import PACKAGE, changes, copied, run, shown
from scenes import WHITE, look_down, settings, sun

RADIUS = 0.7


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """A copy of the engine, with the type and kernels that know it."""
    pytest.importorskip("ziglang")
    names = ", ".join(f'"{name}"' for name in LIGHT_TYPES)
    last = re.search(r"^ *X\(AREA, .*\n", (PACKAGE / "lights" / "types.h").read_text(encoding="utf-8"), re.M)[0]
    title = "Add a type of light"
    package = copied(tmp_path_factory.mktemp("engine"),
                     {"lights/beam.py": shown(title, "python"), "lights/beam.h": shown(title, "c")},
                     [("scene/description.py", f"LIGHT_TYPES = ({names})", f'LIGHT_TYPES = ({names}, "BEAM")'),
                      ("lights/types.h", '#include "area.h"\n', '#include "area.h"\n#include "beam.h"\n'),
                      ("lights/types.h", last, last + last.replace("AREA", "BEAM").replace("area", "beam"))])
    for old in package.glob("kernels*"):
        old.unlink()
    compiler = [sys.executable, "-m", "ziglang", "cc", "-std=c11", f"-I{package / 'support'}"]
    expanded = subprocess.run([*compiler, "-w", "-E", "-x", "c", "-"], input=sources.included(package).encode(),
                              capture_output=True, check=True).stdout
    slots = package.parent / "slots.c"
    slots.write_text(declarations.calls(expanded.decode()))
    subprocess.run([*compiler, "-shared", "-fPIC", "-O0", "-g0", "-fno-sanitize=undefined", "-Wall", "-Wextra",
                    "-Werror", "-ffp-contract=off",
                    f'-DSOURCES="{sources.digest(package)}"', "-o", package / sources.library(sys.platform), slots,
                    *sources.sources(package), *(["-lm"] if sys.platform != "win32" else [])], check=True)
    return package


def test_it_is_a_pair_of_files_and_three_lines_elsewhere(extended):
    files, lines = changes(extended)
    assert files == {"lights/beam.py", "lights/beam.h"}
    assert 1 <= len(lines) <= 3, lines


@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES", "AREA_SAMPLING"])
def test_it_lights_a_disc(extended, tmp_path, shadows):
    """Where the beam falls the floor is as the sun lights it; elsewhere it is dark, and so is a plate's shadow."""
    lamp = sun((0, 0, -1), 2.0)
    scene = Scene.from_shapes([Shape(rectangle((-3, -3), (3, 3), 0.0), WHITE, "floor"),
                      Shape(rectangle((0, -3), (3, 3), 1.0), WHITE, "plate", flags={"visible_camera": False})],
                     look_down(0, 0, 2, 48), [lamp], settings(shadows=shadows, ambient=0.0))
    done = render_image(scene, ("Combined", "Position"))
    lit, P = done.passes["Combined"][..., :3], done.passes["Position"]
    beam = replace(lamp, type="BEAM", position=(-0.2, 0.1, 3.0), radius=RADIUS)
    away = np.hypot(P[..., 0] + 0.2, P[..., 1] - 0.1) - RADIUS
    expected = np.where(away[..., None] < 0, lit, 0)
    assert (expected > 0.5).any() and (np.abs(away) > 1e-4).all()
    snapshot.write(replace(scene, lights=(lamp,)), tmp_path / "scene")
    file = tmp_path / "scene" / "scene.json"
    text = file.read_text(encoding="utf-8")
    changed = text.replace('"type": "SUN"', '"type": "BEAM"').replace(
        '"position": [0.0, 0.0, 0.0]', '"position": [-0.2, 0.1, 3.0]').replace('"radius": 0.0', f'"radius": {RADIUS}')
    assert changed.count("BEAM") == 1 and str(beam.radius) in changed
    file.write_text(changed, encoding="utf-8")
    ran = run(extended, "render", tmp_path / "scene", "-o", tmp_path / "beam.exr")
    assert ran.returncode == 0, ran.stderr
    found = oiio.ImageBuf(str(tmp_path / "beam.exr")).get_pixels(oiio.FLOAT)[::-1]
    np.testing.assert_allclose(found[..., :3], expected, rtol=1e-5, atol=1e-7)


def test_the_kernels_have_the_types_in_the_registrys_order():
    text = (PACKAGE / "lights" / "types.h").read_text(encoding="utf-8")
    assert re.findall(r"^ *X\((\w+), \w+_way", text, re.M) == registry.NAMES
    assert set(registry.KINDS) == set(LIGHT_TYPES)
