"""Fixtures: the add-on in bpy, an empty scene, and functions that render or export it and return the result."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import light_meshes.scene.snapshot
import numpy as np
import pytest
from exr import write_layers

bpy = pytest.importorskip("bpy", reason="bpy is not installed: pip install 'light-meshes[blender]'")
oiio = pytest.importorskip("OpenImageIO")

ENGINE = 'LIGHT_MESHES'


@pytest.fixture(scope="session")
def addon():
    """The add-on, registered once while the tests run, also if tests of two folders use it."""
    import light_meshes_addon

    first = not hasattr(bpy.types.Scene, "light_meshes")
    if first:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        light_meshes_addon.register()
    yield light_meshes_addon
    if first:
        light_meshes_addon.unregister()


@pytest.fixture
def scene(addon):
    """An empty scene of 64×48 pixels, with a camera at z = 10 that looks down, a black world, and exact colours.

    Only the file is new: to read Blender's preferences for each test would take seven times as long.
    """
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = ENGINE
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0  # what lamps give, and nothing else
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    scene.view_settings.view_transform = 'Standard'
    scene.camera = add(bpy.data.cameras.new("Camera"), location=(0, 0, 10))
    return scene


def add(data, name=None, **properties):
    """Add a new object with this data to the scene."""
    ob = bpy.data.objects.new(name or (data.name if data else "Empty"), data)
    bpy.context.scene.collection.objects.link(ob)
    for key, value in properties.items():
        setattr(ob, key, value)
    return ob


@pytest.fixture(name="add")
def add_fixture():
    return add


@pytest.fixture
def add_mesh():
    """(name, vertices, faces, **object properties) → object."""
    def make(name, vertices, faces, **properties):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(vertices, [], faces)
        return add(mesh, **properties)
    return make


@pytest.fixture
def add_plane(add_mesh):
    """Add a square of side 2·half around the origin, facing up."""
    def make(half=1.0, name="Plane", **properties):
        corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
        return add_mesh(name, corners, [(0, 1, 2, 3)], **properties)
    return make


@pytest.fixture
def add_light():
    """(type, **light properties) → object, 4 above the origin, shining down, with shadow edges of one width."""
    def make(kind='POINT', location=(0, 0, 4), rotation=(0, 0, 0), scale=(1, 1, 1), **properties):
        light = bpy.data.lights.new(kind.title(), kind)
        for key, value in properties.items():
            setattr(light, key, value)
        light.light_meshes.softness = 'SCENE'
        return add(light, location=location, rotation_euler=rotation, scale=scale)
    return make


@pytest.fixture
def diffuse():
    """(colour) → a Diffuse BSDF material."""
    def make(color=(0.8, 0.8, 0.8), name="Diffuse"):
        return node_material(name, 'ShaderNodeBsdfDiffuse', Color=(*color, 1))
    return make


def node_material(name, idname, **inputs):
    """Return a material with a single shader node that has these inputs."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new('ShaderNodeOutputMaterial')
    node = tree.nodes.new(idname)
    for key, value in inputs.items():
        node.inputs[key.replace("_", " ")].default_value = value
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


@pytest.fixture(name="node_material")
def node_material_fixture():
    return node_material


@pytest.fixture
def render(tmp_path):
    """(scene) → pass name → float32 (h, w, c), top row first, as read from the EXR that Blender wrote."""
    count = 0

    def run(scene):
        nonlocal count
        count += 1
        path = tmp_path / f"picture-{count}.exr"
        write_layers(scene, path)
        bpy.ops.render.render(write_still=True)
        return read_layers(path)
    return run


def read_layers(path: Path) -> dict[str, np.ndarray]:
    """Return the passes of a multilayer EXR, by the last part of their names."""
    file = oiio.ImageInput.open(str(path))
    assert file, oiio.geterror()
    spec = file.spec()
    pixels = np.asarray(file.read_image(oiio.FLOAT)).reshape(spec.height, spec.width, spec.nchannels)
    file.close()
    channels = {}
    for i, name in enumerate(spec.channelnames):
        parts = name.split(".")
        channels.setdefault(parts[-2], {})[parts[-1]] = pixels[:, :, i]
    return {
        name: np.stack([found[c] for c in sorted(found, key="RGBXYZUVA".index)], axis=-1)
        for name, found in channels.items()
    }


@pytest.fixture
def snapshot(tmp_path, addon):
    """(scene) → the engine's Scene, after an export and a read."""
    from light_meshes_addon.render_engine import LightMeshesEngine

    count = 0

    def run(scene):
        nonlocal count
        count += 1
        folder = tmp_path / f"snapshot-{count}"
        LightMeshesEngine.export_to = folder
        try:
            bpy.ops.render.render()
        finally:
            LightMeshesEngine.export_to = None
        return light_meshes.scene.snapshot.read(folder)
    return run


@pytest.fixture
def translated(scene, add_plane, snapshot):
    """(material) → its description, and the warnings."""
    def run(material):
        plane = add_plane()
        plane.data.materials.append(material)
        found = snapshot(scene)
        bpy.data.objects.remove(plane)
        return next(m for m in found.materials if m.name == material.name), found
    return run


@pytest.fixture(scope="session")
def blender_path():
    """The path of a real Blender. Without one the test is skipped, with a message that says how to get one."""
    found = os.environ.get("LIGHT_MESHES_BLENDER") or shutil.which("blender")
    if not found:
        pytest.skip("no Blender: set LIGHT_MESHES_BLENDER or put `blender` on the PATH")
    return found


def look_at(ob, target):
    """Turn a camera or light towards a point."""
    from mathutils import Vector

    ob.rotation_euler = (Vector(target) - ob.location).to_track_quat('-Z', 'Y').to_euler()


@pytest.fixture(name="look_at")
def look_at_fixture():
    return look_at




@pytest.fixture(scope="session")
def blender_environment(blender_path, tmp_path_factory):
    """An environment in which a real Blender has this checkout's add-on enabled, and uses nothing of the user's.

    Without a graphics card most of the time of a window goes into the drawing of each of its pixels by the processor.
    So Blender draws its own lines without anti-aliasing, and no splash screen; no test looks at them.
    """
    import light_meshes_addon

    folder = tmp_path_factory.mktemp("blender")
    (folder / "extensions").mkdir()
    (folder / "extensions" / "light_meshes").symlink_to(Path(light_meshes_addon.__file__).parent)
    environment = os.environ | {
        "BLENDER_USER_RESOURCES": str(folder / "user"),
        "LIGHT_MESHES_PYTHON": sys.executable,
        "TMPDIR": str(folder / "tmp"),
    }
    (folder / "tmp").mkdir()
    enable = (
        "import bpy, addon_utils\n"
        "repos = bpy.context.preferences.extensions.repos\n"
        f"repos.new(name='dev', module='dev', custom_directory={str(folder / 'extensions')!r}, remote_url='')\n"
        "assert addon_utils.enable('bl_ext.dev.light_meshes', default_set=True)\n"
        "preferences = bpy.context.preferences\n"
        "preferences.system.viewport_aa, preferences.view.show_splash = 'OFF', False\n"
        "preferences.system.use_overlay_smooth_wire = preferences.system.use_edit_mode_smooth_wire = False\n"
        "bpy.ops.wm.save_userpref()\n"
    )
    done = subprocess.run([blender_path, "-b", "--python-exit-code", "3", "--python-expr", enable], env=environment,
                          capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return environment


@pytest.fixture
def run_blender(blender_path, blender_environment):
    """(arguments…) → the finished process of a real `blender -b`; keywords are additional environment variables."""
    def run(*arguments, **environment):
        return subprocess.run([blender_path, "-b", *map(str, arguments)], env=blender_environment | environment,
                              capture_output=True, text=True, timeout=180)
    return run


@pytest.fixture(scope="session")
def display():
    """The name of a virtual screen of 1280×1000 pixels."""
    if not shutil.which("Xvfb"):
        pytest.skip("no Xvfb")
    reading, writing = os.pipe()
    process = subprocess.Popen(["Xvfb", "-displayfd", str(writing), "-screen", "0", "1280x1000x24", "+extension", "GLX",
                                "-nolisten", "tcp"], pass_fds=[writing], stderr=subprocess.DEVNULL)
    os.close(writing)
    with os.fdopen(reading) as f:
        name = f":{f.readline().strip()}"
    yield name
    process.terminate()
    process.wait()


@pytest.fixture
def open_blender(blender_path, blender_environment, display, tmp_path):
    """(arguments…) → the output of a real Blender with a window, after it has quit: with the smallest one that it
    opens, unless its size is given, as software draws each of its pixels.
    """
    def run(*arguments, size=("640", "480"), timeout=600):
        environment = blender_environment | {"DISPLAY": display, "LIBGL_ALWAYS_SOFTWARE": "1", "TMPDIR": str(tmp_path)}
        environment.pop("WAYLAND_DISPLAY", None)
        # a file and not a pipe, because processes that Blender leaves behind could keep a pipe open
        log = tmp_path / "log.txt"
        with log.open("w") as f:
            subprocess.run([blender_path, "--window-geometry", "0", "0", *size, *map(str, arguments)],
                           env=environment, stdout=f, stderr=f, timeout=timeout)
        return log.read_text(errors="replace")
    return run


@pytest.fixture(scope="module")
def play_story(blender_path, blender_environment, display, tmp_path_factory):
    """(script) → the results that a script prints in a real Blender with the smallest window that it opens, by title.
    It checks that no engine outlives Blender.
    """
    def play(script):
        folder = tmp_path_factory.mktemp("story")
        environment = blender_environment | {"DISPLAY": display, "LIBGL_ALWAYS_SOFTWARE": "1", "TMPDIR": str(folder)}
        environment.pop("WAYLAND_DISPLAY", None)
        log = folder / "log.txt"
        with log.open("w") as f:
            process = subprocess.Popen([blender_path, "--window-geometry", "0", "0", "640", "480",
                                        "-P", str(Path(__file__).parents[1] / "addon" / script)],
                                       env=environment, stdout=f, stderr=f)
            try:
                process.wait(1500)
            except subprocess.TimeoutExpired:
                pytest.fail(f"{script} has not ended after 25 minutes:\n" + log.read_text(errors="replace")[-4000:])
            finally:
                process.kill()
                process.wait()
        text = log.read_text(errors="replace")
        lines = [json.loads(line[7:]) for line in text.splitlines() if line.startswith("@story ")]
        for line in lines:
            print(line)
        found = {line["what"]: line for line in lines}
        assert "end" in found, text[-4000:]
        end = time.monotonic() + 10
        while time.monotonic() < end and list(folder.glob("light-meshes-*")):
            time.sleep(0.1)
        assert not list(folder.glob("light-meshes-*")), "the engine outlived Blender"
        return found
    return play
