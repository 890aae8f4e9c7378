"""Images have the same colours as in Cycles, in any colour space and with any alpha; sequences; files that are no
images.
"""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import bpy
import image_cases
import light_meshes_addon
import numpy as np
import OpenImageIO as oiio
import pytest
from faults import go
from light_meshes_addon.export import image_files
from test_addon_materials import four, textured  # noqa: F401  a fixture

PYTHONS = [p for p in os.environ.get("LIGHT_MESHES_BPY_PYTHONS", "").split(os.pathsep) if p]


@pytest.mark.parametrize("python", [sys.executable, *(pytest.param(p, marks=pytest.mark.slow) for p in PYTHONS)])
def test_colours_are_those_of_cycles(python, tmp_path):
    """Each file format, alpha mode and colour space, in each working space that this Blender has."""
    told = ("import bpy, os, sys; print('\\n', *bpy.app.version); "
            "print(bpy.utils.system_resource('DATAFILES', path='colormanagement') + '/config.ocio'); "
            "sys.stdout.flush(); os._exit(0)")
    version, config = subprocess.run([python, "-c", told], capture_output=True, text=True,
                                     check=True).stdout.strip().splitlines()[-2:]
    version = tuple(map(int, version.split()))
    (tmp_path / "packages").mkdir()
    (tmp_path / "packages" / "light_meshes_addon").symlink_to(Path(light_meshes_addon.__file__).parent)
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "packages"), "LIGHT_MESHES_PYTHON": sys.executable}
    other = "ACEScg" if version < (5, 2) else "Linear Rec.2020"
    spaces = ["Linear Rec.709", other] if version >= (5, 0) else []
    done = subprocess.run([python, image_cases.__file__, tmp_path, *spaces], env=environment, capture_output=True,
                          text=True, timeout=180)
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads((tmp_path / "cases.json").read_text())
    unread = bool(oiio.ColorConfig(config).geterror())  # Blender 5.2's asks for OpenImageIO 3.1
    assert ("read as sRGB" in done.stdout + done.stderr) == unread
    for space, pictures in found.items():
        ours, cycles = (np.array(pictures[engine]) for engine in ('LIGHT_MESHES', 'CYCLES'))
        wrong = np.abs(ours[:, :3] - cycles[:, :3]).max(1) > 0.006 * np.maximum(1, cycles[:, :3].max(1))
        wrong |= np.abs(ours[:, 3] - cycles[:, 3]) > 0.25  # where it is a matter of luck with Cycles
        if unread:
            wrong &= [case[3] not in image_cases.CONVERTED for case in image_cases.CASES]
        assert not wrong.any(), [(space, image_cases.CASES[i], ours[i], cycles[i]) for i in np.flatnonzero(wrong)]


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="this Blender has one working space")
def test_a_colour_that_feeds_a_number_has_the_luminance_of_the_working_space(scene, addon):
    from light_meshes_addon.export import color

    assert sum(color.luminance_weights()) == pytest.approx(1, abs=1e-5)
    assert color.luminance_weights()[1] == pytest.approx(0.7152, abs=1e-4)
    bpy.ops.wm.set_working_color_space(working_space='ACEScg', convert_colors=False)
    assert color.luminance_weights()[1] == pytest.approx(0.6743, abs=1e-4)  # AP1's green


# Sequences and movies

@pytest.fixture
def shown(scene, add_plane, add_light, render):
    """(material) → the colour in the middle of the picture, by this engine and by Cycles."""
    plane = add_plane(5)
    plane.data.uv_layers.new(name="UV")
    add_light('SUN', energy=np.pi, angle=0)
    scene.light_meshes.shadows = 'SHARP'

    def run(material):
        plane.data.materials.clear()
        plane.data.materials.append(material)
        for node in material.node_tree.nodes:
            if node.type == 'BSDF_PRINCIPLED':
                node.inputs["Specular IOR Level"].default_value = 0
        colours = []
        for engine in ('LIGHT_MESHES', 'CYCLES'):
            scene.render.engine = engine
            scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 4, False, 0
            colours.append(render(scene)["Combined"][24, 32, :3])
        scene.render.engine = 'LIGHT_MESHES'
        return colours
    return run


def frames(folder, count, first=1):
    """Files frame.0001.png…, each of another grey."""
    for n in range(count):
        image = bpy.data.images.new("frame", 2, 2)
        image.generated_color = ((n + 1) / 10, 0.5, 0.5, 1)
        image.filepath_raw, image.file_format = str(folder / f"frame.{first + n:04d}.png"), 'PNG'
        image.save()
        bpy.data.images.remove(image)
    return folder / f"frame.{first:04d}.png"


@pytest.mark.parametrize("user", [
    {}, {"frame_start": 3}, {"frame_offset": 2, "frame_duration": 2}, {"use_cyclic": True, "frame_duration": 3},
    {"use_cyclic": True, "frame_duration": 2, "frame_start": 4, "frame_offset": 1},
])
def test_a_sequence_shows_the_frame_that_cycles_shows(scene, shown, tmp_path, user):
    image = bpy.data.images.load(str(frames(tmp_path, 5)))
    image.source = 'SEQUENCE'
    material = textured(image, "Sequence")
    settings = next(n for n in material.node_tree.nodes if n.type == 'TEX_IMAGE').image_user
    settings.use_auto_refresh = True
    for name, value in ({"frame_duration": 5} | user).items():
        setattr(settings, name, value)
    seen = set()
    for frame in (2, 4, 7, 1):
        scene.frame_set(frame)
        ours, cycles = shown(material)
        exists = Path(image_files.path_of(image, settings, frame)).is_file()
        assert not exists or ours == pytest.approx(cycles, abs=2e-3), frame
        seen.add(round(float(ours[0]), 3))
    assert len(seen) > 1


def test_a_frame_that_is_not_there_is_named(scene, shown, tmp_path, capfd):
    image = bpy.data.images.load(str(frames(tmp_path, 1)))
    image.source = 'SEQUENCE'
    material = textured(image, "Sequence")
    next(n for n in material.node_tree.nodes if n.type == 'TEX_IMAGE').image_user.frame_duration = 9
    scene.frame_set(3)
    ours, cycles = shown(material)
    assert ours == pytest.approx(cycles, abs=2e-3) and cycles == pytest.approx((1, 0, 1), abs=2e-3)
    assert "frame.0003.png' cannot be read (no such file" in capfd.readouterr().out


def test_two_nodes_may_show_two_frames(scene, add_plane, snapshot, tmp_path):
    image = bpy.data.images.load(str(frames(tmp_path, 3)))
    image.source = 'SEQUENCE'
    for offset in (0, 1):
        plane = add_plane()
        plane.data.uv_layers.new(name="UV")
        plane.data.materials.append(textured(image, f"Offset {offset}"))
        node = plane.data.materials[0].node_tree.nodes["Image Texture"]
        node.image_user.frame_duration, node.image_user.frame_offset = 3, offset
    assert {Path(i.path).name for i in snapshot(scene).images} == {"frame.0001.png", "frame.0002.png"}


@pytest.mark.parametrize(("path", "number", "expected"), [
    ("/a/f.0001.png", 12, "/a/f.0012.png"), ("/b2/x9y.exr", 10, "/b2/x10y.exr"),
    ("/c/f1_v07.tif", 3, "/c/f1_v03.tif"), ("/d/none.png", 3, "/d/none.png"), ("/e/f.12.png", -4, "/e/f.00.png"),
])
def test_the_number_in_a_name(path, number, expected):
    assert image_files.numbered(path, number) == expected


# Images that only Blender has

@pytest.mark.skipif("save_copy" not in bpy.types.Image.bl_rna.functions["save"].parameters,
                    reason="this Blender saves no copies")
@pytest.mark.parametrize("kind", ["pattern", "painted", "painted without alpha", "floats", "JPEG",
                                  "Non-Color", "Linear Rec.709"])
def test_bytes_are_handed_over_as_bytes(scene, add_plane, snapshot, kind):
    """All of them, and the image is as it was. Blender's own PNG, which takes no floats; else what Python is given."""
    size, depth = (40, 24), "without" not in kind
    image = bpy.data.images.new("Image", *size, alpha=depth, float_buffer=kind == "floats")
    image.generated_type = 'COLOR_GRID'
    if kind != "pattern":
        pixels = np.random.default_rng(1).random(size[0] * size[1] * 4).astype(np.float32)
        image.pixels.foreach_set(pixels)
        image.update()
    if kind == "JPEG":
        image.file_format = 'JPEG'
    if kind in {"Non-Color", "Linear Rec.709"}:
        image.colorspace_settings.name = kind
    before = image.is_dirty, image.filepath, image.source
    plane = add_plane()
    plane.data.uv_layers.new(name="UV")
    plane.data.materials.append(textured(image, "Material"))
    path = Path(snapshot(scene).images[0].path)
    assert path.suffix == (".png" if kind in {"pattern", "painted", "Non-Color"} else ".tif")
    assert (image.is_dirty, image.filepath, image.source) == before
    file = oiio.ImageInput.open(str(path), _unassociated())
    spec = file.spec()
    found = np.asarray(file.read_image(oiio.FLOAT)).reshape(spec.height, spec.width, -1)
    file.close()
    expected = np.empty(size[0] * size[1] * 4, np.float32)
    image.pixels.foreach_get(expected)
    expected = expected.reshape(*size[::-1], 4)[::-1]
    if kind == "floats":
        np.testing.assert_array_equal(found, expected)
    else:
        np.testing.assert_array_equal(np.rint(found * 255), np.rint(expected * 255))


def _unassociated():
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    return config


@pytest.mark.skipif(not os.access("/proc/self/clear_refs", os.W_OK), reason="this system does not tell")
@pytest.mark.skipif("save_copy" not in bpy.types.Image.bl_rna.functions["save"].parameters,
                    reason="this Blender saves no copies")
def test_a_generated_image_takes_few_bytes(tmp_path):
    """Of 4096²: its own 4 bytes a texel, and little more. Floats, and bytes made of them, took 20 together."""
    lines, output = go(tmp_path, """
        def memory(what):
            status = Path("/proc/self/status").read_text()
            return int(status.split(what + ":")[1].split()[0]) * 1024

        fast()
        render()
        image = bpy.data.images.new("Large", 4096, 4096)
        tree = bpy.data.objects["Cube"].active_material.node_tree
        node = tree.nodes.new('ShaderNodeTexImage')
        node.image = image
        tree.links.new(node.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])
        scene.render.resolution_x = scene.render.resolution_y = 16
        Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
        before = memory("VmRSS")
        render()
        print("PEAK", (memory("VmHWM") - before) / 4096**2)
        leave()
    """)
    assert lines[:2] == ["RESULT {'FINISHED'} True"] * 2, output
    peak = float(output.split("PEAK", 1)[1].split()[0])
    print(f"{peak:.1f} bytes a texel")
    assert peak < 10


# What is no file

@pytest.fixture
def not_files(tmp_path):
    """What an artist's path may lead to."""
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "folder.png").mkdir()
    with socket.socket(socket.AF_UNIX) as s:
        s.bind(str(tmp_path / "socket.png"))
    (tmp_path / "link.png").symlink_to(tmp_path / "pipe.png")
    (tmp_path / "circle.png").symlink_to(tmp_path / "circle.png")
    return {tmp_path / "pipe.png": "is a named pipe", tmp_path / "folder.png": "is a folder",
            tmp_path / "socket.png": "is a socket", tmp_path / "link.png": "is a named pipe",
            tmp_path / "circle.png": "cannot be read (", Path("/dev/zero"): "is a device",
            Path("/proc/kcore"): "", Path("/proc/self/maps"): "is the system's own",
            tmp_path / "none.png": "cannot be read (no such file"}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_what_is_no_file_is_named_and_not_opened(scene, add_plane, snapshot, four, not_files):  # noqa: F811
    for n, (path, _) in enumerate(not_files.items()):
        image = bpy.data.images.load(str(four), check_existing=False)
        image.name = f"Image {n}"
        image.filepath = str(path)
        plane = add_plane(name=f"Plane {n}")
        plane.data.uv_layers.new(name="UV")
        plane.data.materials.append(textured(image, f"Material {n}"))
    found = snapshot(scene)
    missing = {found.images[m.image].path for m in found.materials}
    assert len(missing) == 1 and oiio.ImageBuf(missing.pop()).get_pixels().tolist() == [[[1, 0, 1, 1]]]
    for n, (path, reason) in enumerate(not_files.items()):
        assert any(f"'Image {n}'" in w and str(path) in w and reason in w for w in found.warnings), (path, reason)
