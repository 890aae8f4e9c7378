"""A shadow method is one file, and its name in one line elsewhere: the recipe of docs/developers.md, followed."""

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.description import SHADOWS, Settings
from light_meshes.scene.errors import SceneError
from light_meshes.shadows import registry
from recipes import changes, copied, run, shown
from scenes import four_lights


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """A copy of the engine, with the method."""
    names = ", ".join(f'"{name}"' for name in SHADOWS)
    return copied(tmp_path_factory.mktemp("engine"), {"shadows/half.py": shown("Add a shadow method", "python")},
                  [("scene/description.py", f"SHADOWS = ({names})", f'SHADOWS = ({names}, "HALF")')])


def test_it_is_one_new_file_and_at_most_two_lines_elsewhere(extended):
    files, lines = changes(extended)
    assert files == {"shadows/half.py"}
    assert 1 <= len(lines) <= 2, lines


@pytest.mark.parametrize("share", [None, 0.25])
def test_it_renders(extended, tmp_path, share):
    scene = replace(four_lights(24).with_settings(mode="LOCAL"), world_color=(0.0, 0.0, 0.0))  # no light but lamps
    full = render_image(scene).passes["Combined"]
    snapshot.write(scene.with_settings(mode="RAY_CASTING"), tmp_path / "scene")
    own = [] if share is None else ["--set", f"method.share={share}"]
    done = run(extended, "render", tmp_path / "scene", "-o", tmp_path / "half.exr", "--set", "shadows=HALF", *own)
    assert done.returncode == 0, done.stderr
    found = oiio.ImageBuf(str(tmp_path / "half.exr")).get_pixels(oiio.FLOAT)[::-1]
    assert full[..., :3].max() > 0.1
    np.testing.assert_allclose(found[..., :3], (share or 0.5) * full[..., :3], rtol=1e-5)


def test_a_snapshot_holds_its_setting(extended, tmp_path):
    scene = four_lights(8).with_settings(method={"share": 0.25})
    snapshot.write(scene, tmp_path / "scene")
    assert snapshot.read(tmp_path / "scene").settings == scene.settings
    done = run(extended, "render", tmp_path / "scene", "-o", tmp_path / "x.exr", "--set", "shadows=HALF")
    assert done.returncode == 0, done.stderr
    done = run(extended, "render", tmp_path / "scene", "-o", tmp_path / "x.exr")  # of another method
    assert done.returncode == 1 and "method of LIGHT_MESHES: there is no property 'share'" in done.stderr


@pytest.mark.parametrize(("setting", "sentence"), [
    ("method.share=2", "share is 2; it must lie between 0 and 1"), ("method.share=yes", "must be a finite number"),
    ("method.part=0.5", "there is no property 'part'; there are share")])
def test_its_setting_is_checked(extended, tmp_path, setting, sentence):
    snapshot.write(four_lights(8), tmp_path / "scene")
    done = run(extended, "render", tmp_path / "scene", "-o", tmp_path / "x.exr", "--set", "shadows=HALF", "--set",
               setting)
    assert done.returncode == 1 and sentence in done.stderr, done.stderr


def test_the_registry_has_the_methods_that_a_scene_can_name():
    assert set(registry.KINDS) == {registry.NONE, *SHADOWS}
    with pytest.raises(SceneError, match="no property 'share'"):
        registry.check(Settings(method={"share": 0.5}))
