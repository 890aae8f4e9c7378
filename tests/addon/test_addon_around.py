"""A file may ask Blender for more work around a render: a snapshot is still written, no other file is, and Blender goes
on.
"""

import os
import subprocess
import sys
from pathlib import Path

import light_meshes.scene.snapshot
import pytest
from blender_scene import SCENE

PYTHONS = [p for p in os.environ.get("LIGHT_MESHES_BPY_PYTHONS", "").split(os.pathsep) if p]
AROUND = """
import sys
from pathlib import Path
import light_meshes_addon
if "bl_ext" not in light_meshes_addon.__package__:
    light_meshes_addon.register()
""" + SCENE + """
import importlib
export_frame = importlib.import_module(light_meshes_addon.__package__ + ".render_engine").export_frame
folder = Path(sys.argv[-1])
render, layer = scene.render, scene.view_layers[0]
render.filepath = str(folder / "still_")
render.use_freestyle = layer.freestyle_settings.as_render_pass = True
render.use_stamp = render.use_persistent_data = True
render.use_border, render.border_max_x = True, 0.5
scene.view_layers.new("Without the plane").layer_collection.exclude = True
scene.view_layers.new("Off").use = False
if bpy.app.version >= (5, 0):
    tree = scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
else:
    scene.use_nodes = True
    tree = scene.node_tree
output = tree.nodes.new('CompositorNodeOutputFile')
if bpy.app.version >= (5, 0):
    output.directory, output.file_name = str(folder), "node_"
    output.file_output_items.new('RGBA', "Image")
else:
    output.base_path = str(folder / "node_")
tree.links.new(tree.nodes.new('CompositorNodeRLayers').outputs[0], output.inputs[0])
def all_of():
    return {p.identifier: str(getattr(render, p.identifier)) for p in render.bl_rna.properties if p.type != 'POINTER'}
before = all_of()
export_frame(scene, folder / "snapshot")
assert all_of() == before
bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
for layer in scene.view_layers:
    layer.use = False
try:
    export_frame(scene, folder / "nothing")
except RuntimeError as e:
    assert "renders no view layer" in str(e)
assert sorted(p.name for p in folder.iterdir()) == ["scene.blend", "snapshot"], list(folder.iterdir())
print("SURVIVED", flush=True)
"""
LEAVE = "from light_meshes_addon.headless import leave\nleave(0)\n"


def check(folder):
    scene = light_meshes.scene.snapshot.read(folder / "snapshot")
    assert scene.camera.crop == (0, 0, 32, 48)
    assert len(scene.geometry.triangles) == 2  # of the layer that is seen, not of the last one


@pytest.mark.parametrize("python", ["", *PYTHONS], ids=lambda p: Path(p).parents[1].name if p else "bpy")
def test_a_snapshot_of_a_file_with_everything(python, tmp_path):
    import light_meshes_addon

    (tmp_path / "packages").mkdir()
    (tmp_path / "packages" / "light_meshes_addon").symlink_to(Path(light_meshes_addon.__file__).parent)
    (tmp_path / "out").mkdir()
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "packages"), "LIGHT_MESHES_PYTHON": sys.executable}
    done = subprocess.run([python or sys.executable, "-P", "-c", AROUND + LEAVE, tmp_path / "out"], env=environment,
                          capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and "SURVIVED" in done.stdout, done.stdout[-2000:] + done.stderr[-2000:]
    check(tmp_path / "out")
    if not python:  # the command exports in the same way
        (tmp_path / "work").mkdir()
        command = Path(sys.executable).parent / "light-meshes"
        done = subprocess.run([command, "inspect", tmp_path / "out" / "scene.blend"], cwd=tmp_path / "work",
                              capture_output=True, text=True, timeout=120)
        assert done.returncode == 0 and "2 of 1 meshes" in done.stdout, done.stdout + done.stderr
        assert not [*(tmp_path / "work").iterdir()] and len([*(tmp_path / "out").iterdir()]) == 2


@pytest.mark.slow
def test_in_a_real_blender(run_blender, tmp_path):
    code = AROUND.replace("import light_meshes_addon\n", "import bl_ext.dev.light_meshes as light_meshes_addon\n")
    (tmp_path / "story.py").write_text(code)
    (tmp_path / "out").mkdir()
    done = run_blender("--python-exit-code", "3", "-P", tmp_path / "story.py", "--", tmp_path / "out")
    assert done.returncode == 0 and "SURVIVED" in done.stdout, done.stdout[-2000:] + done.stderr[-2000:]
    check(tmp_path / "out")
