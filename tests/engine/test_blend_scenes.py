"""The project's .blend files can be opened and are translated completely, and S3 is the scene of the paper."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from light_meshes.frontends import blend
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from oracle import Oracle
from scenes import S3_LIGHT, project, tabletop

SCENES = Path(__file__).parents[2] / "blend_scenes"
pytestmark = pytest.mark.skipif(not (importlib.util.find_spec("bpy") or shutil.which("blender")),
                                reason="neither bpy nor a blender on the PATH")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """name → the scene that the add-on makes of NAME.blend."""
    done = {}

    def scene(name):
        if name not in done:
            folder = tmp_path_factory.mktemp(name)
            blend.export(SCENES / f"{name}.blend", folder, [], False)
            done[name] = snapshot.read(folder)
        return done[name]
    return scene


@pytest.mark.parametrize("name", sorted(p.stem for p in SCENES.glob("*.blend")))
def test_everything_in_it_is_translated(exported, name):
    assert exported(name).warnings == ()
    assert (SCENES / f"{name}.blend").stat().st_size < 1_000_000


def test_the_tabletop_is_the_papers(exported):
    """Same solids, camera, light and lattice as the description that the method's tests render."""
    found, expected = exported("tabletop"), tabletop(1000)
    corners = [np.unique(Oracle(s).triangles.reshape(-1, 3).round(5), axis=0) for s in (found, expected)]
    np.testing.assert_allclose(*corners, atol=2e-5)
    assert len(found.geometry.triangles) == len(expected.geometry.triangles)
    np.testing.assert_allclose(found.camera.matrix, expected.camera.matrix, atol=1e-6)
    np.testing.assert_allclose(found.camera.window, expected.camera.window, atol=1e-6)
    assert (found.camera.width, found.camera.height) == (1000, 1000)
    assert [light.type for light in found.lights] == ["POINT"]
    np.testing.assert_allclose(found.lights[0].position, S3_LIGHT, atol=1e-6)
    assert (found.settings.h, found.settings.kI, found.settings.auto_h) == (pytest.approx(0.05), 3.0, False)


def test_the_crop_of_the_parameters_shows_the_end_of_the_bars_shadow(exported):
    scene = exported("parameters")
    x0, y0, x1, y1 = scene.camera.crop
    light = np.array(S3_LIGHT)
    tip = light + (np.array((1.7, 0, 1.325)) - light) * light[2] / (light[2] - 1.325)
    x, y = project(scene, tip)
    assert x0 < x * scene.camera.width < x1 and y0 < y * scene.camera.height < y1


def test_the_command_renders_it_as_the_engine_does(exported, tmp_path):
    """.blend → Blender → add-on → engine → EXR, against the engine on the exported scene."""
    import OpenImageIO as oiio
    out = tmp_path / "out.exr"
    done = subprocess.run([sys.executable, "-m", "light_meshes.cli", "render", str(SCENES / "parameters.blend"), "-o",
                           str(out)], capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    file = oiio.ImageInput.open(str(out))
    pixels, names = file.read_image(oiio.FLOAT)[::-1], [n.split(".")[-1] for n in file.spec().channelnames]
    expected = render_image(exported("parameters")).passes["Combined"]
    found = pixels[..., [names.index(c) for c in "RGB"]]
    assert found.shape == expected[..., :3].shape
    np.testing.assert_allclose(found, expected[..., :3], rtol=2e-3)  # Blender writes half floats
