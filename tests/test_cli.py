"""The command `light-meshes` on snapshots: pictures, exit codes, one sentence on stderr."""

import os
import resource
import subprocess
import sys
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes import film, snapshot
from light_meshes.cli import UsageError, frame_numbers
from light_meshes.passes import PASSES
from light_meshes.render import render_image
from light_meshes.scene import SceneError
from scenes import tabletop, with_lights, with_settings


def run(*arguments):
    return subprocess.run([sys.executable, "-m", "light_meshes.cli", *map(str, arguments)], capture_output=True,
                          text=True, timeout=120)


def read(path):
    """(pixels bottom-up, channel names)."""
    file = oiio.ImageInput.open(str(path))
    pixels = file.read_image(oiio.FLOAT)
    return pixels[::-1], list(file.spec().channelnames)


def with_shadow_pass():
    scene = tabletop(40)
    return with_lights(scene, *(replace(light, shadow_pass=3) for light in scene.lights))


@pytest.fixture
def folder(tmp_path):
    snapshot.write(with_shadow_pass(), tmp_path / "scene")
    return tmp_path


def test_an_exr_has_the_linear_picture_and_all_passes(folder):
    done = run("render", folder / "scene", "-o", folder / "out.exr")
    assert done.returncode == 0 and done.stderr == ""
    pixels, names = read(folder / "out.exr")
    expected = render_image(with_shadow_pass(), (*PASSES, "Shadow 3")).passes
    channels = {name: "RGBA" if name == "Combined" else [f"{name}.{c}" for c in PASSES.get(name, "RGB")]
                for name in expected}
    assert len(names) == sum(map(len, channels.values())) and {"Depth.Z", "UV.A", "Shadow 3.R"} < set(names)
    for name, found in channels.items():
        np.testing.assert_array_equal(pixels[..., [names.index(c) for c in found]], expected[name], err_msg=name)


def test_a_png_is_srgb(folder):
    assert run("render", folder / "scene", "-o", folder / "out.png").returncode == 0
    pixels, _ = read(folder / "out.png")
    x = np.clip(render_image(tabletop(40)).passes["Combined"][..., :3], 0, 1)
    expected = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(pixels[..., :3], expected, atol=0.51 / 255)


def test_settings_are_changed_by_set(folder):
    done = run("render", folder / "scene", "-o", folder / "out.exr", "--set", "shadows=SHARP", "--set", "samples=4",
               "--set", "filter_size=1.5")
    assert done.returncode == 0
    expected = render_image(with_settings(tabletop(40), shadows="SHARP", samples=4, filter_size=1.5))
    np.testing.assert_array_equal(read(folder / "out.exr")[0][..., :4], expected.passes["Combined"])


def test_inspect_says_what_the_scene_holds_and_what_is_planned(folder):
    done = run("inspect", folder / "scene")
    assert done.returncode == 0
    for word in ("triangles", "408", "light", "0.05"):
        assert word in done.stdout


FAILURES = [
    (["render", "{f}/nowhere", "-o", "{f}/o.png"], 1, "does not exist"),
    (["render", "{f}", "-o", "{f}/o.png"], 1, "scene.json"),
    (["render", "{f}/scene", "-o", "{f}/no/folder.png"], 1, "folder"),
    (["render", "{f}/scene", "-o", "/proc/out.png"], 1, "out.png"),
    (["render", "{f}/nowhere.blend", "-o", "{f}/o.png"], 1, "does not exist"),
    (["render", "{f}/scene", "-o", "{f}/o.jpg"], 2, "png"),
    (["render", "{f}/scene"], 2, "-o"),
    (["render"], 2, "FILE"),
    (["dance"], 2, "dance"),
    ([], 2, "COMMAND"),
    (["render", "{f}/scene", "-o", "{f}/o.png", "--set", "kI"], 2, "key=value"),
    (["render", "{f}/scene", "-o", "{f}/o.png", "--set", "blur=3"], 2, "blur"),
    (["render", "{f}/scene", "-o", "{f}/o.png", "--set", "kI=99"], 2, "kI"),
    (["render", "{f}/scene", "-o", "{f}/o.png", "--set", "shadows=FUZZY"], 2, "LIGHT_MESHES"),
    (["render", "{f}/scene", "-o", "{f}/o.png", "--set", "samples=many"], 2, "samples"),
    (["render", "{f}/scene", "-o", "{f}/o.png", "-f", "1"], 2, "frame"),
    (["render", "{f}/scene", "-o", "{f}/o.png", "-f", "one"], 2, "one"),
    (["render", "{f}/broken", "-o", "{f}/o.png"], 1, "cut short"),
    (["inspect", "{f}/nowhere"], 1, "does not exist"),
]


@pytest.mark.parametrize(("arguments", "code", "word"), FAILURES, ids=[" ".join(f[0]) or "nothing" for f in FAILURES])
def test_failures_have_a_code_and_a_sentence(folder, arguments, code, word):
    snapshot.write(tabletop(8), folder / "broken")
    os.truncate(folder / "broken" / "vertices.npy", 200)
    done = run(*(a.replace("{f}", str(folder)) for a in arguments))
    assert done.returncode == code
    assert word in done.stderr
    assert "Traceback" not in done.stderr
    assert not (folder / "o.png").exists()


@pytest.mark.parametrize("suffix", ["png", "exr"])
def test_a_full_disk_leaves_the_older_picture_and_nothing_else(folder, small_disk, suffix):
    prefix, disk = small_disk
    script = f"echo old > {disk}/o.{suffix}; yes | head -c 4500000 > {disk}/filler; " \
        f'"$@" && exit 9; rm {disk}/filler; cd {disk}; echo $(ls) $(cat o.{suffix})'
    done = subprocess.run([*prefix, "sh", "-c", script, "sh", sys.executable, "-m", "light_meshes.cli", "render",
                           folder / "scene", "-o", f"{disk}/o.{suffix}"], capture_output=True, text=True, timeout=120)
    assert f"o.{suffix} cannot be written" in done.stderr and "Traceback" not in done.stderr
    assert done.stdout == f"o.{suffix} old\n", done.stdout + done.stderr


def test_debug_shows_the_traceback(folder):
    done = run("render", folder / "nowhere", "-o", folder / "o.png", "--debug")
    assert done.returncode == 1 and "Traceback" in done.stderr


def test_warnings_of_the_scene_are_passed_on(folder):
    snapshot.write(replace(tabletop(8), warnings=("Material 'Jelly': Subsurface is left out",)), folder / "scene")
    done = run("render", folder / "scene", "-o", folder / "out.png")
    assert done.returncode == 0 and "Jelly" in done.stderr


def test_a_picture_that_cannot_be_written_whole_leaves_the_one_before(tmp_path):
    frame = film.Framebuffer(64, 64, {"Combined": np.random.default_rng(0).random((64, 64, 4), np.float32)})
    path = tmp_path / "out.exr"
    path.write_bytes(b"the one before")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(SceneError, match=r"out\.exr cannot be written"):
            film.write(frame, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [p.name for p in tmp_path.iterdir()] == ["out.exr"] and path.read_bytes() == b"the one before"
    film.write(frame, path)
    assert [p.name for p in tmp_path.iterdir()] == ["out.exr"] and path.stat().st_size > 10_000


def test_resume_leaves_a_picture_that_is_there(folder):
    (folder / "out.exr").write_bytes(b"rendered before")
    done = run("render", folder / "scene", "-o", folder / "out.exr", "--resume")
    assert done.returncode == 0 and "is there already" in done.stdout
    assert (folder / "out.exr").read_bytes() == b"rendered before"
    done = run("render", folder / "scene", "-o", folder / "other.exr", "--resume")
    assert done.returncode == 0 and len(read(folder / "other.exr")[1]) > 4


def test_frames_are_listed_as_blender_does_and_as_farms_do():
    assert frame_numbers("1,3..5") == frame_numbers("1,3-5") == [1, 3, 4, 5]
    assert frame_numbers("-3--1") == [-3, -2, -1] and frame_numbers("7-7") == [7]
    with pytest.raises(UsageError, match="empty"):
        frame_numbers("5-3")
