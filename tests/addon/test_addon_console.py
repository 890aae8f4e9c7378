"""Blender still renders if its standard streams are closed, full or cannot encode some characters; on the command
line.
"""

import subprocess
import sys

import pytest
from blender_scene import SCENE, read

SCRIPT = SCENE + """
import sys
material.name = "Матовый \\x1b[2J"
material.light_meshes.override_Od = False
tree = material.node_tree
if tree is None:
    material.use_nodes = True
    tree = material.node_tree
tree.nodes.clear()
tree.links.new(tree.nodes.new('ShaderNodeBsdfToon').outputs[0], tree.nodes.new('ShaderNodeOutputMaterial').inputs[0])
scene.light_meshes.samples = 1
scene.render.filepath = sys.argv[-1]
bpy.ops.render.render(write_still=True)
"""
ENDS = [">&- 2>&- <&-", ">/dev/full", "2>&-"]


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.slow
def test_a_real_blender(blender_path, blender_environment, tmp_path, end):
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run(["bash", "-c", f'"$@" {end}', "bash", blender_path, "-b", "--python-exit-code", "3", "-P",
                           tmp_path / "script.py", "--", tmp_path / "out.png"], env=blender_environment,
                          capture_output=True, timeout=120)
    assert done.returncode == 0, done
    assert read(tmp_path / "out.png").any()


@pytest.mark.parametrize(("end", "encoding"), [(ENDS[0], "utf-8"), (ENDS[1], "utf-8"), ("", "ascii"), ("", "cp1251")])
def test_bpy(blender_environment, tmp_path, end, encoding):
    script = "import light_meshes_addon\nlight_meshes_addon.register()\n" + SCRIPT + \
        "from light_meshes_addon.headless import leave\nlight_meshes_addon.unregister()\nleave(0)\n"
    (tmp_path / "script.py").write_text(script, encoding="utf-8")
    done = subprocess.run(["bash", "-c", f'"$@" {end}', "bash", sys.executable, tmp_path / "script.py",
                           tmp_path / "out.png"], env=blender_environment | {"PYTHONIOENCODING": encoding},
                          capture_output=True, timeout=120)
    assert done.returncode == 0, done
    assert read(tmp_path / "out.png").any() and b"\x1b" not in done.stdout
