"""Nothing in the current folder is run or changes what is run, because a scene's folder may come from other people."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import light_meshes.scene.snapshot
import pytest
from blender_scene import SCENE, read
from light_meshes.frontends import blend
from light_meshes.picture.render import render_image
from scenes import tabletop

BIN = Path(sys.executable).parent
# Modules that Python, the engine, the add-on or Blender look for, and programs.
MODULES = ["bpy", "queue", "json", "re", "tempfile", "argparse", "numpy", "embreex", "OpenImageIO",
           "light_meshes", "light_meshes_addon", "sitecustomize", "usercustomize", "encodings", "scipy", "runpy"]
RENDER = """
from light_meshes_addon import session
import light_meshes_addon
light_meshes_addon.register()
""" + SCENE + """
scene.render.filepath = sys.argv[1]
bpy.ops.render.render(write_still=True)
from light_meshes_addon.headless import leave
light_meshes_addon.unregister()
leave(0)
"""


@pytest.fixture
def hostile(tmp_path):
    """A folder whose every file says in `ran` that it was run."""
    folder = tmp_path / "downloaded"
    folder.mkdir()
    for name in MODULES:
        trap = f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r} + ' ')\nraise SystemExit('trapped')\n"
        (folder / f"{name}.py").write_text(trap)
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text(trap)
    for name in ("blender", "python", "python3", "light-meshes"):
        (folder / name).write_text(f"#!/bin/sh\nprintf '{name} ' >> {tmp_path / 'ran'}\n")
        (folder / name).chmod(0o755)
    yield folder
    assert not (tmp_path / "ran").exists(), (tmp_path / "ran").read_text()


def run(folder, *command, **environment):
    done = subprocess.run(list(map(str, command)), cwd=folder, env=os.environ | environment, capture_output=True,
                          text=True, timeout=240)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done


@pytest.fixture(scope="module")
def blend_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "scene.blend"
    code = "import sys, bpy, light_meshes_addon\nlight_meshes_addon.register()\n" + SCENE + \
        "bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])\nfrom light_meshes_addon.headless import leave\nleave(0)"
    subprocess.run([sys.executable, "-P", "-c", code, path], check=True, capture_output=True, timeout=120)
    return path


@pytest.mark.parametrize("command", [(BIN / "light-meshes",), (sys.executable, "-m", "light_meshes.cli")],
                         ids=["light-meshes", "python -m"])
def test_the_command(hostile, tmp_path, blend_file, command):
    if "-m" in command:  # where Python itself looks for what it is to run
        for name in ("runpy", "light_meshes"):
            (hostile / f"{name}.py").unlink()
            shutil.rmtree(hostile / name)
    light_meshes.scene.snapshot.write(tabletop(8, samples=1), tmp_path / "scene")
    run(hostile, *command, "render", tmp_path / "scene", "-o", "snapshot.exr")
    expected = render_image(tabletop(8, samples=1)).passes["Combined"][::-1]
    assert (read(hostile / "snapshot.exr")[..., :4] == expected).all()
    run(hostile, *command, "render", blend_file, "-o", "blend.exr", "-f", "1")
    assert read(hostile / "blend.exr")[24, 32, 0] > 0.3
    assert "Plan" in run(hostile, *command, "inspect", blend_file).stdout


@pytest.mark.parametrize(("python", "path"), [("", None), ("", ":"), ("python3", ".:"), ("wrapper", ":")])
def test_the_engine_of_the_add_on(hostile, tmp_path, python, path):
    """By Blender's own Python or another; with a PYTHONPATH and a PATH that mean the current folder as well."""
    if python == "wrapper":  # such as environments of conda or nix have
        python = tmp_path / "python"
        python.write_text(f"#!/bin/sh\nexec {sys.executable} \"$@\"\n")
        python.chmod(0o755)
    # The script's own folder is the first to be looked in: another one. And PYTHONPATH changes once Python is there.
    script = tmp_path / "render.py"
    environment = f"import os, sys; os.environ.update(PATH=':.:{BIN}:' + os.environ['PATH'])\n"
    environment += f"sys.path.append(os.getcwd()); os.environ['PYTHONPATH'] = {path!r}\n" if path else ""
    script.write_text("import bpy, light_meshes_addon\n" + environment + RENDER)
    run(hostile, sys.executable, script, tmp_path / "out.png", LIGHT_MESHES_PYTHON=str(python))
    assert (tmp_path / "out.png").exists()


def test_a_folder_that_is_named_is_used(tmp_path):
    """Developers name folders in PYTHONPATH, and pip's editable installations do in site-packages."""
    frontends = tmp_path / "light_meshes" / "frontends"
    frontends.mkdir(parents=True)
    for folder in (frontends.parent, frontends):
        (folder / "__init__.py").touch()
    (frontends / "service.py").write_text("raise SystemExit('found')")
    code = "from light_meshes_addon import session\ntry:\n    while True: session.current().poll(9)\n" \
        "except session.EngineError as e: print(e.log)\nsession.end()"
    for python in ("", "python3"):
        said = run(tmp_path, sys.executable, "-P", "-c", f"import bpy\n{code}", PYTHONPATH=str(tmp_path),
                   LIGHT_MESHES_PYTHON=python, PATH=f"{BIN}:{os.environ['PATH']}").stdout
        assert "found" in said


def test_a_blender_on_the_path(hostile, monkeypatch, tmp_path):
    real = tmp_path / "bin" / "blender"
    real.parent.mkdir()
    real.touch(mode=0o755)
    monkeypatch.chdir(hostile)
    for path in ("", ".", "./", "/no/such:.:"):
        monkeypatch.setenv("PATH", f"{path}:{real.parent}")
        assert blend.blender() == str(real)
        monkeypatch.setenv("PATH", path)
        assert blend.blender() is None


@pytest.mark.slow
def test_a_real_blender(hostile, blender_path, blender_environment, tmp_path):
    scene = hostile / "scene.blend"
    run(tmp_path, blender_path, "-b", "--python-expr", f"{SCENE}bpy.ops.wm.save_as_mainfile(filepath={str(scene)!r})",
        **blender_environment)
    for python in (sys.executable, "python3"):
        run(hostile, blender_path, "-b", scene, "-E", "LIGHT_MESHES", "-o", tmp_path / "out_##", "-F", "PNG",
            "-f", "1", **blender_environment | {"LIGHT_MESHES_PYTHON": python,
                                                "PATH": f":.:{BIN}:{os.environ['PATH']}", "PYTHONPATH": ":."})
        (tmp_path / "out_01.png").unlink()


def test_a_python_that_is_older_is_named(tmp_path, hostile):
    """Pythons before 3.11 know no -P."""
    old = tmp_path / "python3.10"
    old.write_text('#!/bin/sh\n[ "$1" = -c ] || { echo "unknown option $1" >&2; exit 2; }\n'
                   f'exec {sys._base_executable} -S "$@"\n')
    old.chmod(0o755)
    code = "import bpy, json\nfrom light_meshes_addon import session\ntry:\n" \
        "    while True: session.current().poll(9)\n" \
        "except session.EngineError as e: print(json.dumps(str(e)))\nsession.end()"
    said = run(tmp_path, sys.executable, "-P", "-c", code, LIGHT_MESHES_PYTHON=str(old)).stdout
    assert "has no package 'light_meshes'" in json.loads(said.splitlines()[-1])
