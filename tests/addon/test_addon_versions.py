"""Every supported version of bpy renders the same picture: LIGHT_MESHES_BPY_PYTHONS lists Pythons that have one."""

import inspect
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from blender_fixtures import read_layers
from blender_scene import SCENE, read
from test_addon_left_out import unknown_inputs

PYTHONS = [p for p in os.environ.get("LIGHT_MESHES_BPY_PYTHONS", "").split(os.pathsep) if p]
pytestmark = [pytest.mark.slow, pytest.mark.parametrize("python", PYTHONS or [pytest.param(
    None, marks=pytest.mark.skip(reason="LIGHT_MESHES_BPY_PYTHONS names no Python with another bpy"))])]

# What differs most between versions: kinds of objects, instances, nodes, light settings, passes, file formats.
SCRIPT = "import sys, bpy, light_meshes_addon\nlight_meshes_addon.register()\n" + SCENE + """
layer = scene.view_layers[0]
from light_meshes_addon import passes
for p in passes.ALL.values():
    setattr(p.owner(layer), p.switch, True)
# What Cycles of this version calls its passes.
from cycles.engine import list_render_passes
cycles, ours = (set(map(tuple, found)) for found in (
    list_render_passes(scene, layer), [(p.name, p.channel_ids, p.kind) for p in passes.wanted(scene, layer)]))
assert {name for name, _, _ in ours - cycles} == {
    "Ambient", "Shadow", "Debug Candidates", "Debug m", "Debug Empty", "Debug Skipped"}, ours - cycles
sun.light_meshes.shadow_pass = True
text = add(bpy.data.curves.new("Text", 'FONT'), location=(-3, 2.5, 0.5))
text.data.body = "Light"
cube = bpy.data.meshes.new("Cube")
cube.from_pydata([(x, y, z) for x in (-.2, .2) for y in (-.2, .2) for z in (0, .4)], [],
                 [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
child = add(cube)
points = bpy.data.meshes.new("Points")
points.from_pydata([(-1, 0, 0), (1, 0, 0)], [], [])
child.parent = add(points, instance_type='VERTS')
lamp = add(bpy.data.lights.new("Spot", 'SPOT'), location=(0, 0, 3))
lamp.data.energy, lamp.data.spot_size = 50, 0.5
image = scene.render.image_settings
if hasattr(image, "media_type"):
    image.media_type = 'MULTI_LAYER_IMAGE'
image.file_format, image.color_depth = 'OPEN_EXR_MULTILAYER', '32'
if hasattr(image, "use_exr_interleave"):
    image.use_exr_interleave = True
scene.light_meshes.samples = 16
scene.render.filepath = sys.argv[1]
bpy.ops.render.render(write_still=True)
image.file_format = 'OPEN_EXR_MULTILAYER'
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2])
from light_meshes_addon.headless import leave
light_meshes_addon.unregister()
leave(0)
"""


@pytest.fixture
def environment(tmp_path):
    """Only the add-on comes from here; the engine runs in the tests' Python."""
    import light_meshes_addon

    (tmp_path / "packages").mkdir()
    (tmp_path / "packages" / "light_meshes_addon").symlink_to(Path(light_meshes_addon.__file__).parent)
    return os.environ | {"PYTHONPATH": str(tmp_path / "packages"), "LIGHT_MESHES_PYTHON": sys.executable,
                         "TMPDIR": str(tmp_path)}


def run(arguments, environment):
    done = subprocess.run(list(map(str, arguments)), env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


# What the view layer and the lens say, and a preview.
MORE = "import sys, bpy, light_meshes_addon\nlight_meshes_addon.register()\n" + SCENE + """
layer = scene.view_layers[0]
clay = bpy.data.materials.new("Clay")
clay.light_meshes.override_Od = True
clay.light_meshes.Od = (0.1, 0.2, 0.3)
clay.light_meshes.override_ks = True
clay.light_meshes.ks = 0
layer.material_override, layer.samples = clay, 64
sky = bpy.data.worlds.new("Sky")
sky.use_nodes = True
sky.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0.25, 0, 1)
layer.world_override = sky
scene.light_meshes.ambient = 0
lens = scene.camera.data
lens.dof.use_dof, lens.dof.focus_distance = True, 5
lens.dof.aperture_fstop = lens.lens / 1000 / 2 / 0.5
image = scene.render.image_settings
if hasattr(image, "media_type"):
    image.media_type = 'MULTI_LAYER_IMAGE'
image.file_format, image.color_depth = 'OPEN_EXR_MULTILAYER', '32'
if hasattr(image, "use_exr_interleave"):
    image.use_exr_interleave = True
scene.render.filepath = sys.argv[1]
bpy.ops.render.render(write_still=True)
red = bpy.data.materials.new("Red")
red.use_nodes = True
red.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.8, 0.05, 0.05, 1)
red.asset_mark()
red.asset_generate_preview()
pixels = list(red.preview.image_pixels_float)
print("\\nMEAN", *(sum(pixels[c::4]) / len(pixels[::4]) for c in range(4)), flush=True)
from light_meshes_addon.headless import leave
light_meshes_addon.unregister()
leave(0)
"""


def test_version(python, environment, tmp_path):
    output, blend = tmp_path / "picture.exr", tmp_path / "scene.blend"
    run([python, "-c", SCRIPT, output, blend], environment)
    found = read_layers(output)
    assert len(found) == 22
    assert {"Combined", "Depth", "Mist", "Normal", "Shadow", "Shadow Sun", "UV", "Ambient"} < set(found)
    assert found["Shadow Sun"][36, 32] == pytest.approx((1, 1, 1)) and found["UV"][36, 32, 2] == 1
    combined = found["Combined"]
    assert combined.shape == (48, 64, 4)
    assert combined[36, 32, :3] == pytest.approx((0.5, 0.5, 0.5), abs=2e-3)  # the plane, out of the spot
    # The plane under the spot: 50 W at 3 m.
    assert combined[24, 32, 0] == pytest.approx(0.5 + 0.5 * 50 / (4 * np.pi**2 * 9), abs=1e-3)
    assert not combined[46, 2, :3].any() and found["Depth"][46, 2, 0] > 1e9
    assert found["Depth"][36, 32, 0] == pytest.approx(10, abs=0.01)
    assert found["Normal"][36, 32] == pytest.approx((0, 0, 1), abs=1e-3)
    # The cubes, which hang from points, are nearer; so is the text.
    assert found["Depth"][24, 22, 0] == pytest.approx(9.6, abs=0.01)
    assert found["Depth"][24, 41, 0] == pytest.approx(9.6, abs=0.01)
    assert (np.abs(found["Depth"][:18, :32] - 9.5) < 0.01).sum() > 10
    assert not list(tmp_path.glob("light-meshes-*"))

    lines = run([python, "-m", "light_meshes_addon.headless", "render", blend, "-o", tmp_path / "again.png",
                 "-f", "1..2", "--set", "samples=4"], environment)
    assert lines.count('"event": "wrote"') == 2
    assert read(tmp_path / "again_0002.png")[36, 32, 0] > 0.3
    assert not list(tmp_path.glob("light-meshes-*")) and not list(tmp_path.glob("blender_*"))


def test_overrides_depth_of_field_and_previews(python, environment, tmp_path):
    said = run([python, "-c", MORE, tmp_path / "picture.exr"], environment)
    combined = read_layers(tmp_path / "picture.exr")["Combined"]
    assert combined[24, 32, :3] == pytest.approx((0.1, 0.2, 0.3), abs=2e-3)
    assert combined[2, 2, :3] == pytest.approx((0, 0.25, 0), abs=1e-5)
    # The plane's edge at distance 10, focus at 5: a circle of confusion of radius 0.5 on a pixel of 0.1125.
    step = np.diff(combined[24, 32:, 0]) / -0.1
    x = np.arange(len(step)) - (step * np.arange(len(step))).sum()
    assert step.sum() == pytest.approx(1, abs=0.02)
    assert (step * x**2).sum() == pytest.approx((0.5 / 0.1125) ** 2 / 4, rel=0.15)
    red, green, blue, alpha = map(float, said[said.index("MEAN"):].split("\n")[0].split()[1:])
    assert red > 2 * green > 0 and red > 2 * blue > 0 and 0.4 < alpha < 0.6


def test_every_input_of_a_translated_shader_is_known(python, environment, tmp_path):
    """Those that only this version has, too: each is read, or listed as left out."""
    script = tmp_path / "inputs.py"
    script.write_text("import os, bpy, light_meshes_addon\nfrom light_meshes_addon.export import left_out\n"
                      f"{inspect.getsource(unknown_inputs)}\nprint(unknown_inputs(), flush=True)\nos._exit(0)\n")
    found = next(line for line in run([python, script], environment).splitlines() if line.startswith("{"))
    assert "'ShaderNodeBsdfPrincipled': set()" in found and found.count("set()") == found.count("ShaderNode"), found
