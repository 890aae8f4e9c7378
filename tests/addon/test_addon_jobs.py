"""A frame of an animation has the same step, radii and bits in a real Blender, however the job is divided."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from blender_scene import read

pytestmark = pytest.mark.slow

# A camera that flies off by a driver, over two instances of one lamp above each a blocker; frame 20 is seen from afar.
MAKE = """
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.engine = 'CYCLES'
if hasattr(scene, "light_meshes"):
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
scene.render.resolution_x, scene.render.resolution_y = 24, 16
scene.frame_start, scene.frame_end = 3, 30
def add(name, data, collection=scene.collection, **properties):
    ob = bpy.data.objects.new(name, data)
    collection.objects.link(ob)
    for key, value in properties.items():
        setattr(ob, key, value)
    return ob
def plane(name, half, **properties):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    return add(name, mesh, **properties)
plane("Floor", 40)
lamp = bpy.data.lights.new("Lamp", 'POINT')
lamp.energy, lamp.shadow_soft_size = 400, 0.5
lamps = bpy.data.collections.new("Lamps")
add("Lamp", lamp, lamps)
for x, z in ((-5, 3), (5, 9)):
    add("Instance", None, instance_type='COLLECTION', instance_collection=lamps, location=(x, 0, z))
    plane("Blocker", 0.6, location=(x, 0, 1))
scene.camera = add("Camera", bpy.data.cameras.new("Camera"))
scene.camera.driver_add("location", 2).driver.expression = "14 + 2 * (frame - 3)"
image = scene.render.image_settings
image.file_format, image.color_depth, image.exr_codec = 'OPEN_EXR', '32', 'NONE'
"""
ENABLE = "import bpy, addon_utils; addon_utils.enable('bl_ext.dev.light_meshes')"
# An add-on that is switched on late cannot know whether a file is new, so what depends on that is set.
SIZED = ("import bpy; bpy.data.lights['Lamp'].light_meshes.softness = 'LIGHT_SIZE'; "
         "bpy.context.scene.light_meshes.share_samples = True")


@pytest.fixture(scope="module")
def blend(blender_path, tmp_path_factory):
    """Made where there was no add-on, so that nothing of it stands in the file."""
    path = tmp_path_factory.mktemp("jobs") / "scene.blend"
    subprocess.run([blender_path, "-b", "--factory-startup", "--python-expr",
                    MAKE + f"bpy.ops.wm.save_as_mainfile(filepath={str(path)!r})"],
                   check=True, capture_output=True, timeout=120)
    return path


@pytest.fixture
def rendered(run_blender, tmp_path):
    """(arguments) → h, and the picture of frame 20, as a job of a real Blender has them."""
    def run(*arguments, number=20):
        done = run_blender(*arguments)
        picture = tmp_path / f"frame_{number:04}.exr"
        assert done.returncode == 0 and picture.exists(), done.stdout + done.stderr
        steps = set(re.findall(r"^Light Meshes: .* h ([\d.e+-]+),", done.stdout, re.M))
        pixels = read(picture)
        picture.unlink()
        assert len(steps) == 1, done.stdout
        return steps.pop(), pixels
    return run


def test_the_same_frame_of_every_job(rendered, blend, tmp_path):
    out = ("-E", "LIGHT_MESHES", "--python-expr", SIZED, "-o", tmp_path / "frame_####")
    h, pixels = rendered(blend, *out, "-f", 20)
    assert float(h) == pytest.approx(14 * 36 / 50 / 200, rel=0.05)  # of frame 3, the first in the file
    for job in (["-s", 20, "-e", 20, "-a"], ["-s", 19, "-e", 21, "-a"], ["-s", 2, "-e", 20, "-j", 9, "-a"],
                ["--python-expr", "import bpy; bpy.context.scene.frame_start = 18", "-f", 20],
                ["-s", 20, "-f", "20..21"]):
        again, same = rendered(blend, *out, *job)
        assert again == h, job
        np.testing.assert_array_equal(same, pixels, err_msg=str(job))
    late = ["--factory-startup", blend, "-s", 20, "-e", 20, "--python-expr",
            f"import sys; sys.path.insert(0, {str(Path(__file__).parents[2])!r})\nimport bpy, importlib.util as u\n"
            "s = u.spec_from_file_location('light_meshes_addon', sys.path[0] + '/addon/__init__.py',\n"
            "    submodule_search_locations=[sys.path[0] + '/addon'])\n"
            "m = sys.modules['light_meshes_addon'] = u.module_from_spec(s); s.loader.exec_module(m); m.register()",
            *out, "-a"]
    again, same = rendered(*late)
    assert again == h
    np.testing.assert_array_equal(same, pixels)
    driven = ["--factory-startup", "-P", Path(__file__).parents[2] / "addon" / "headless.py", "--", "render"]
    sized = tmp_path / "sized.blend"
    again, _ = rendered(blend, *out, "-s", 20, "-e", 20, "--python-expr",
                        f"import bpy; bpy.ops.wm.save_as_mainfile(filepath={str(sized)!r})", "-a")
    assert again == h
    again, same = rendered(*driven, sized, "-o", tmp_path / "frame_####.exr", "-f", "20")  # saved with another range
    assert again == h
    np.testing.assert_array_equal(same, pixels)


def test_f12_in_a_window_is_the_frame_of_the_farm(rendered, open_blender, blend, tmp_path):
    out = ("-E", "LIGHT_MESHES", "--python-expr", SIZED, "-o", tmp_path / "frame_####")
    _, pixels = rendered(blend, *out, "-s", 20, "-e", 20, "-a")
    (tmp_path / "window.py").write_text(f"""
import bpy
scene = bpy.context.scene
scene.render.engine = 'LIGHT_MESHES'
{SIZED}
scene.frame_start = 15  # as an artist does who renders the rest of an animation again
scene.frame_set(20)
def render():
    scene.render.filepath = {str(tmp_path / "window.exr")!r}
    bpy.app.handlers.render_write.append(lambda *_: bpy.app.timers.register(bpy.ops.wm.quit_blender, first_interval=1))
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.render.render('INVOKE_DEFAULT', write_still=True)
bpy.app.timers.register(render, first_interval=1)
""")
    said = open_blender(blend, "-P", tmp_path / "window.py", timeout=120)
    assert (tmp_path / "window.exr").exists(), said[-3000:]
    np.testing.assert_array_equal(read(tmp_path / "window.exr"), pixels)


def test_threads(run_blender, blend, tmp_path):
    """Those of the file and of Blender's switch, as Cycles takes them."""
    tell = ("import bpy\nfrom bl_ext.dev.light_meshes.observers import observers\nobservers.append(lambda e: "
            "print('\\nTHREADS', e['statistics']['threads'], flush=True) if e['event'] == 'statistics' else 0)")
    out = ("-E", "LIGHT_MESHES", "--python-expr", tell, "-o", tmp_path / "frame_####")
    fixed = ("--python-expr", "import bpy; r = bpy.context.scene.render; r.threads_mode, r.threads = 'FIXED', 3")
    for arguments, threads in ((["-t", 1, blend, *out], 1), ([blend, *out, *fixed], 3)):
        said = run_blender(*arguments, "-f", 3).stdout
        assert re.findall(r"^THREADS (\d+)", said, re.M) == [str(threads)], said
