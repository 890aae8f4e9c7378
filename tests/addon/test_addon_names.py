"""Names in a file, and output of its scripts, can control neither the command that renders it nor the terminal."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from blender_scene import SCENE

COMMAND = Path(sys.executable).parent / "light-meshes"
# Before the name ends, lines as the driver and the engine say them, and as a terminal obeys them.
EVIL = "é\x1b[2J\n" + "@light-meshes " + json.dumps({"event": "wrote", "path": "/x"}) + "\r\u202etxt\x07"
FAKES = """
import sys
for line in ('{"event": "error", "message": "hacked"}', '{"event": "progress"}', 'no JSON', '[' * 3000, '"x"',
             '{"event": 3}', '{"event": "wrote", "path": 7}', '{"event": "end"}'):
    print("@light-meshes " + line, flush=True)
    sys.stderr.write("@light-meshes " + line + chr(10))
"""


@pytest.fixture(scope="module")
def blend(tmp_path_factory):
    """Objects, materials, a lamp, an image, a scene and a layer with evil names; a script that prints at each frame."""
    path = tmp_path_factory.mktemp("files") / "scene.blend"
    code = "import sys, bpy, light_meshes_addon\nlight_meshes_addon.register()\n" + SCENE + f"EVIL = {EVIL!r}\n" + """
for block in (scene, scene.view_layers[0], plane, mesh, material, sun, scene.camera, scene.collection.children):
    if hasattr(block, "name"):
        block.name = EVIL
mesh.materials.append(None)
tree = bpy.data.materials.new(EVIL + "2")
if bpy.app.version < (5, 0):
    tree.use_nodes = True
mesh.materials.append(tree)
nodes = tree.node_tree
nodes.nodes.clear()
toon = nodes.nodes.new('ShaderNodeBsdfToon')
toon.name = EVIL
nodes.links.new(toon.outputs[0], nodes.nodes.new('ShaderNodeOutputMaterial').inputs[0])
mesh.polygons[0].material_index = 2
sun.light_meshes.softness, sun.angle = 'LIGHT_SIZE', 0.1
scene.light_meshes.samples = 1
text = bpy.data.texts.new("fakes.py")
text.use_module = True
text.from_string(sys.argv[2])
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
from light_meshes_addon.headless import leave
leave(0)
"""
    subprocess.run([sys.executable, "-P", "-c", code, path, FAKES], check=True, capture_output=True, timeout=120)
    return path


def run(folder, *arguments, command=(COMMAND,), **environment):
    done = subprocess.run([*command, *map(str, arguments)], cwd=folder, capture_output=True, timeout=120,
                          env=os.environ | environment)
    return done.returncode, (done.stdout + done.stderr).decode()


def steers(said):
    return [c for c in said if not c.isprintable() and c != "\n"]


def test_names_in_the_file(blend, tmp_path):
    code, said = run(tmp_path, "render", blend, "-o", "out.png")
    assert code == 0 and not steers(said), ascii(said)
    assert r"\x1b[2J\n@light-meshes" in said  # the warning about the node names its material
    assert [p.name for p in tmp_path.iterdir()] == ["out.png"]
    code, said = run(tmp_path, "inspect", blend)
    assert code == 0 and not steers(said) and r"\u202etxt" in said
    code, said = run(tmp_path, "render", blend, "-o", "out.png", "--debug")
    assert code == 0 and not steers(said), ascii(said)


def driver(folder, before, *arguments):
    """The command, where Blender runs `before` first, as an add-on does that the user has enabled."""
    (folder / "packages").mkdir(exist_ok=True)
    (folder / "packages" / "sitecustomize.py").write_text(
        f"import sys\nif 'light_meshes_addon.headless' in sys.orig_argv:\n    exec({before!r})\n")
    return run(folder, *arguments, PYTHONPATH=str(folder / "packages"))


def test_lines_that_a_script_prints(blend, tmp_path):
    code, said = driver(tmp_path, FAKES, "render", blend, "-o", "out.png")
    assert code == 0 and "hacked" not in said and "Blender ended" not in said, said
    assert f"{tmp_path / 'out.png'} in " in said and (tmp_path / "out.png").exists()


def test_a_script_that_ends_blender_is_no_success(blend, tmp_path):
    """With the exit code of success."""
    quits = FAKES + "import atexit, os, threading\nthreading.Timer(1.0, os._exit, (0,)).start()\n"
    code, said = driver(tmp_path, quits, "render", blend, "-o", "out.png", "--set", "samples=4096",
                        "--set", "resolution=1920x1080")
    assert code == 1 and "Blender ended with code 0" in said and not (tmp_path / "out.png").exists(), said
