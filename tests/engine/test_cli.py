"""The command `light-meshes` on snapshots: pictures, exit codes, one sentence on stderr."""

import os
import resource
import subprocess
import sys
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes.cli import UsageError, frame_numbers
from light_meshes.film import images as film
from light_meshes.film.passes import PASSES
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.errors import SceneError
from scenes import tabletop, with_lights


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
    expected = render_image(tabletop(40).with_settings(shadows="SHARP", samples=4, filter_size=1.5))
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


@pytest.mark.parametrize("suffix", ["png", "exr"])
def test_resume_leaves_whole_pictures_only(folder, suffix):
    out = folder / f"out.{suffix}"
    assert run("render", folder / "scene", "-o", out).returncode == 0
    picture, before = out.read_bytes(), out.stat().st_mtime_ns
    done = run("render", folder / "scene", "-o", out, "--resume")
    assert done.returncode == 0 and "is there already" in done.stdout and out.stat().st_mtime_ns == before
    assert film.whole(out)
    for broken in (b"", b"no picture", picture[:100], picture[:len(picture) // 2], picture[:-1], bytes(len(picture))):
        out.write_bytes(broken)
        assert not film.whole(out), len(broken)
    done = run("render", folder / "scene", "-o", out, "--resume")
    assert done.returncode == 0 and "is there already" not in done.stdout and film.whole(out)


def test_more_passes_than_a_file_holds_are_refused_before_they_are_rendered(tmp_path):
    with pytest.raises(SceneError, match="9000-channel images; render fewer passes"):
        film.check_channels(tmp_path / "o.exr", ["Normal"] * 3000)
    film.check_channels(tmp_path / "o.exr", ["Normal"] * 30)
    assert not list(tmp_path.iterdir())


def test_multilayer_and_tiled_pictures_are_whole_to_their_end(tmp_path):
    pixels = np.random.default_rng(0).random((200, 300, 7), np.float32)
    for tile in (0, 64):
        spec = oiio.ImageSpec(300, 200, 7, oiio.FLOAT)
        spec.tile_width = spec.tile_height = tile
        path = tmp_path / f"tiles-{tile}.exr"
        out = oiio.ImageOutput.create(str(path))
        assert out.open(str(path), spec) and out.write_image(pixels) and out.close()
        assert film.whole(path)
        path.write_bytes(path.read_bytes()[:-5])
        assert not film.whole(path)


def test_what_cannot_be_written_is_refused_before_it_is_rendered(folder):
    """The scene is none, which nobody looks at."""
    (folder / "scene" / "scene.json").write_text("{")
    (folder / "taken.exr").mkdir()
    for name, why in ((f"{'n' * 300}.exr", "File name too long"), ("taken.exr", "is a folder"),
                      ("no/such/o.exr", "does not exist"), ("/proc/o.exr", "o.exr cannot be written")):
        done = run("render", folder / "scene", "-o", folder / name)
        assert done.returncode == 1 and why in done.stderr and "scene.json" not in done.stderr, done.stderr
    assert sorted(p.name for p in folder.iterdir()) == ["scene", "taken.exr"]


def test_frames_are_listed_as_blender_does_and_as_farms_do():
    assert frame_numbers("1,3..5") == frame_numbers("01,3-05") == [range(1, 2), range(3, 6)]
    assert frame_numbers("-3--1") == [range(-3, 0)] and frame_numbers("7-7") == [range(7, 8)]
    assert frame_numbers("-1048574..1048574") == [range(-1048574, 1048575)]
    with pytest.raises(UsageError, match="empty"):
        frame_numbers("5-3")
    for beyond in ("1048575", "1..9999999999", "-1048575..1", f"{'9' * 999}"):
        with pytest.raises(UsageError, match="from -1048574 to 1048574"):
            frame_numbers(beyond)
