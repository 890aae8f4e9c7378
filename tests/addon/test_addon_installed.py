"""The zip works as an artist installs it: only Blender, no other Python, no network, a new user folder. And the wheel
in it could be published.
"""

import base64
import copy
import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from blender_scene import SCENE, read

ROOT = Path(__file__).parents[2]
PLATFORM = {"linux": "linux-x64", "darwin": "macos-arm64", "win32": "windows-x64"}[sys.platform]
PYTHONS = [p for p in os.environ.get("LIGHT_MESHES_BPY_PYTHONS", "").split(os.pathsep) if p]


def builder(root: Path):
    """addon/build.py of a checkout."""
    spec = importlib.util.spec_from_file_location("build", root / "addon" / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


build = builder(ROOT)
libraries = sys.modules["libraries"]  # as build imported it, so that its errors are the same classes
HERE = build.PLATFORMS[PLATFORM].target


@pytest.fixture(scope="module")
def zipped(tmp_path_factory):
    """The zip for this system."""
    return build.build_zip(PLATFORM, tmp_path_factory.mktemp("zip"))[0]


@pytest.fixture(scope="module")
def wheels(zipped, tmp_path_factory):
    """The wheels in the zip, the engine's own first."""
    folder = tmp_path_factory.mktemp("wheels")
    with zipfile.ZipFile(zipped) as archive:
        paths = [Path(archive.extract(name, folder)) for name in archive.namelist() if name.startswith("wheels/")]
    return sorted(paths, key=lambda path: not path.name.startswith("light_meshes-"))


class Installed:
    """A Blender of its own, offline, with the add-on installed from a zip."""

    def __init__(self, blender: str, folder: Path, path: Path, wheels: list[Path]) -> None:
        for name in ("user", "tmp", "home", "no programs"):
            (folder / name).mkdir()
        self.blender, self.folder, self.user, self.tmp = blender, folder, folder / "user", folder / "tmp"
        self._alone = [shutil.which("unshare"), "-rn"] if shutil.which("unshare") else []
        if self._alone and subprocess.run([*self._alone, shutil.which("true")], capture_output=True).returncode:
            self._alone = []  # a container that does not allow it
        self.environment = {
            "BLENDER_USER_RESOURCES": str(self.user), "HOME": str(folder / "home"), "TMPDIR": str(self.tmp),
            "PATH": str(folder / "no programs"), "https_proxy": "http://127.0.0.1:9", "http_proxy": "http://127.0.0.1:9",
        }
        said = self.run("-b", "--python-expr", "import sys; print('PYTHON', *sys.version_info[:2])")
        self.version = ".".join(re.search(r"PYTHON (\d+) (\d+)", said).groups())
        assert self.version in build.PYTHONS
        self.zip, self.newer = path, folder / "newer.zip"
        newer = self._newer_checkout(folder / "newer")
        newer.write_zip(PLATFORM, [_newer_wheel(wheels[0], folder), *wheels[1:]], self.newer)

    def run(self, *arguments, program=None, code=0) -> str:
        """What Blender, or another program, says until it has ended."""
        done = subprocess.run([*self._alone, program or self.blender, *map(str, arguments)], env=self.environment,
                              capture_output=True, text=True, errors="replace", timeout=400)
        assert done.returncode == code, done.stdout[-5000:] + done.stderr[-3000:]
        return done.stdout + done.stderr

    def afresh(self, folder: Path) -> "Installed":
        """The same Blender with the same zip, just installed for a user who has never started it."""
        other = copy.copy(self)
        for name in ("user", "tmp", "home"):
            (folder / name).mkdir(parents=True)
        other.folder, other.user, other.tmp = folder, folder / "user", folder / "tmp"
        other.environment = self.environment | {"BLENDER_USER_RESOURCES": str(other.user), "TMPDIR": str(other.tmp),
                                                "HOME": str(folder / "home")}
        other.run("--command", "extension", "install-file", "-r", "user_default", "--enable", self.zip)
        return other

    @staticmethod
    def _newer_checkout(folder: Path):
        for name in ("addon", "engine"):
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "LICENSE", folder)
        for name in ("addon/blender_manifest.toml", "engine/light_meshes/__init__.py"):
            (folder / name).write_text(_renumbered((folder / name).read_text(encoding="utf-8")))
        return builder(folder)


def _renumbered(text: str) -> str:
    return re.sub(r'(?m)(^(?:__)?version(?:__)? = ")[\d.]+"', r'\g<1>99.0.0"', text)


def _newer_wheel(wheel: Path, folder: Path) -> Path:
    """The wheel of version 99.0.0: of the same sources and kernels, which have no version in them."""
    old = build.version()
    path = folder / wheel.name.replace(old, "99.0.0")
    rows = []
    with zipfile.ZipFile(wheel) as archive, zipfile.ZipFile(path, "w") as new:
        for name in archive.namelist():
            data, place = archive.read(name), name.replace(f"-{old}.dist-info", "-99.0.0.dist-info")
            if name.endswith(("light_meshes/__init__.py", "blender_manifest.toml")):
                data = _renumbered(data.decode()).encode()
            elif name.endswith(".dist-info/METADATA"):
                data = data.replace(f"\nVersion: {old}\n".encode(), b"\nVersion: 99.0.0\n")
            elif name.endswith(".dist-info/RECORD"):
                data = "".join([*rows, f"{place},,\n"]).encode()
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).decode().rstrip("=")
            rows.append(f"{place},sha256={digest},{len(data)}\n")
            new.writestr(place, data)
    return path


@pytest.fixture(scope="module")
def installed(blender_path, zipped, wheels, tmp_path_factory):
    found = Installed(blender_path, tmp_path_factory.mktemp("installed"), zipped, wheels)
    assert "Success" in found.run("--command", "extension", "validate", found.zip)
    found.run("--command", "extension", "install-file", "-r", "user_default", "--enable", found.zip)
    found.run("-b", "--python-exit-code", "3", "--python-expr",
              SCENE + f"bpy.ops.wm.save_as_mainfile(filepath={str(found.folder / 'scene.blend')!r})")
    return found


@pytest.mark.slow
def test_the_wheel_can_be_published_and_is_reproducible(wheels):
    """Its kernels have the same bytes as this checkout's, which were compiled at another time and in another place.
    tests/engine/test_build.py builds whole wheels twice.
    """
    wheel = wheels[0]
    target = build.TARGETS[HERE]
    assert wheel.name == f"light_meshes-{build.version()}-py3-none-{target.wheel}.whl"
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        metadata = archive.read(f"light_meshes-{build.version()}.dist-info/METADATA").decode()
    engine = {p.relative_to(ROOT / "engine").as_posix() for p in (ROOT / "engine").rglob("*.py")}
    addon = {f"light_meshes_addon/{p.relative_to(build.ADDON).as_posix()}" for p in build.ADDON.rglob("*.py")
             if p.name not in build.TOOLS}
    kernels = {f"light_meshes/{build.library(target.system, level)}" for level in target.levels}
    assert names == engine | addon | kernels | {"light_meshes/py.typed", "light_meshes_addon/blender_manifest.toml"}
    needs = {re.match(r"[\w-]+", line)[0] for line in re.findall("^Requires-Dist: (.*)$", metadata, re.M)
             if "extra ==" not in line}
    assert needs == {"numpy", "embreex", "OpenImageIO"}
    with zipfile.ZipFile(wheel) as archive:
        for name in kernels:
            assert archive.read(name) == (ROOT / "engine" / name).read_bytes(), (
                f"{name}: if another zig built the checkout's, run `python setup.py -q build_ext --inplace`")


@pytest.mark.slow
def test_what_a_wheel_is_not_is_told(wheels, tmp_path):
    wheel = wheels[0]
    target = build.TARGETS[HERE]
    elsewhere = "manylinux2014_aarch64" if target.system == "darwin" else "macosx_11_0_arm64"
    names = {build.library(target.system, level) for level in target.levels}

    def check(version=None, tag=target.wheel, libraries_=names, **members):
        """The check of a wheel with another version, tag or list of libraries, or with members added."""
        version = version or build.version()
        path = tmp_path / f"light_meshes-{version}-py3-none-{tag}.whl"
        info = f"light_meshes-{build.version()}.dist-info"
        with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(path, "w") as new:
            for name in old.namelist():
                data = old.read(name)
                if name == f"{info}/WHEEL":
                    data = data.replace(target.wheel.encode(), tag.encode())
                new.writestr(name.replace(build.version(), version), data.replace(
                    f"\nVersion: {build.version()}\n".encode(), f"\nVersion: {version}\n".encode()))
            for name, data in members.items():
                new.writestr(name, data)
        return libraries.check_wheel(path, version, tag, libraries_)

    assert len(check()) == len(names)
    for wrong, says in (
        ({"version": build.version() + "+abcd"}, "is not the name of version"),
        ({"tag": elsewhere}, f"is for {target.system} {HERE.split('-')[1]}"),
        ({"libraries_": {"kernels.pyd"}}, "should hold"),
        ({"numba": b""}, "has or needs numba"),
        ({"tag": "manylinux_2_5_x86_64"}, "newer than the tag says") if target.system == "linux" else ({}, None),
    ):
        if says:
            with pytest.raises(libraries.LibraryError, match=re.escape(says)):
                check(**wrong)


def assert_right(picture):
    assert picture.shape[:2] == (48, 64)
    assert picture[24, 32, :3] == pytest.approx((0.5, 0.5, 0.5), abs=2e-3) and not picture[24, 2, :3].any()


@pytest.mark.slow
def test_one_zip_renders(installed):
    """blender -b scene.blend -E LIGHT_MESHES -o … -f 1."""
    installed.run("-b", installed.folder / "scene.blend", "-E", "LIGHT_MESHES", "-o", installed.folder / "f_####", "-F",
                  "OPEN_EXR", "-f", "1")
    assert_right(read(installed.folder / "f_0001.exr"))
    assert not list(installed.tmp.iterdir())


TWICE = """
import json, time
import bpy
scene = bpy.context.scene
scene.render.engine = 'LIGHT_MESHES'
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 320, 240, 100
times = []
for _ in range(3):
    began = time.perf_counter()
    assert bpy.ops.render.render() == {'FINISHED'}
    times.append(time.perf_counter() - began)
print("TIMES", json.dumps(times), flush=True)
"""
COMPILED = 5.0  # seconds: the kernels of release 0.1.0 were compiled at the first picture, for half a minute


@pytest.mark.slow
def test_the_first_picture_takes_no_longer_than_the_second(installed, tmp_path):
    """Right after the installation, for a user who has never rendered: nothing is compiled, unpacked or written then.

    Another installation is tried, up to four, if other programs are busy meanwhile. The difference is printed; on an
    idle machine it is below half a second. Here it only must be far from what compiling took.
    """
    late = []
    for attempt in range(4):
        one = installed.afresh(tmp_path / str(attempt))
        before = sorted(one.folder.rglob("*"))
        said = one.run("-b", ROOT / "blend_scenes" / "tabletop.blend", "--python-exit-code", "3", "--python-expr",
                       TWICE)
        assert sorted(one.folder.rglob("*")) == before
        first, *later = json.loads(re.search(r"^TIMES (.*)$", said, re.M)[1])
        late.append(first - min(later))
        if late[-1] <= COMPILED:
            break
    print(f"the first picture takes {min(late):.2f} s more than the second")
    assert min(late) <= COMPILED


# As a user with a bpy has it, in the same folder.
WITH_BPY = SCENE.replace("import bpy", "import bpy, sys").replace("scene.render.engine", """
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
scene.render.engine""", 1) + """
image = scene.render.image_settings
if hasattr(image, "media_type"):
    image.media_type = 'IMAGE'
image.file_format = 'OPEN_EXR'
scene.render.filepath = sys.argv[2]
bpy.ops.render.render(write_still=True)
session = next(module for name, module in sys.modules.items() if name.endswith("light_meshes.session"))
print("ENGINE", *session._sessions["render"]._process.args[:2], flush=True)
from bl_ext.user_default.light_meshes.headless import leave
bpy.ops.preferences.addon_disable(module="bl_ext.user_default.light_meshes")
leave(0)  # bpy 4.2 may crash, and 4.5 may hang, at the end of a process where an add-on's engine has rendered
"""


@pytest.mark.slow
@pytest.mark.parametrize("python", PYTHONS, ids=[Path(p).parents[1].name for p in PYTHONS])
def test_the_same_zip_renders_in_bpy(installed, python):
    """In other Blenders, older and newer ones, with another Python."""
    picture = installed.folder / f"{Path(python).parents[1].name}.exr"
    said = installed.run("-c", WITH_BPY, installed.zip, picture, program=python)
    assert_right(read(picture))
    assert f"ENGINE {python} -I" in said
    assert not list(installed.tmp.glob("light-meshes-*"))


@pytest.mark.slow
def test_nothing_is_left(installed):
    """F12, disabled, enabled, upgraded and uninstalled in one running Blender."""
    said = installed.run("-b", "--factory-startup", "--python-exit-code", "3", "-P",
                         Path(__file__).with_name("installed_story.py"), "--", installed.folder / "scene.blend",
                         installed.newer, installed.folder / "picture.png")
    told = [(word, json.loads(what)) for word, what in re.findall(r"^([A-Z]+) ([\[{].*)$", said, re.M)]
    renders = [what for word, what in told if word == "RENDER"]
    assert renders == [[["FINISHED"], 1]] * 2  # one child each time
    found = dict(told)
    # Blender takes packages away when no add-on needs them, and brings them back.
    assert found["DISABLED"].pop("files", [[], []])[1] == [] and found["DISABLED"] == {}
    assert found["UPGRADED"] == ["LIGHT_MESHES", 2.5, "SHARP", "UNIFORM", []]
    assert found["VERSIONS"] == [[99, 0, 0], ["light_meshes-99.0.0.dist-info"]]
    assert found["UNINSTALLED"].pop("files")[1] == [] and found["UNINSTALLED"] == {}
    # Blender 4.3 keeps all property groups that have an update function, whoever's.
    assert found["MODULES"] == [] and not [
        name for name in found["ALIVE"] if not re.search(r"\.(surface_)?properties\.", name)]
    assert not list(installed.tmp.iterdir())
    left = [p for p in installed.user.rglob("*") if p.is_file() and p.name not in {"userpref.blend", "compat.dat"}]
    assert not left


def test_settings_of_the_first_version_load(addon, snapshot):
    """first_version.blend was saved by the first add-on there was, in Blender 4.2."""
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(Path(__file__).with_name("first_version.blend")))
    scene = bpy.context.scene
    assert scene.render.engine == 'LIGHT_MESHES'
    found = snapshot(scene)
    settings = found.settings
    assert (settings.mode, settings.shadows, settings.auto_h) == ('RAY_CASTING', 'LIGHT_MESHES', False)
    assert (settings.h, settings.kI, settings.ambient) == pytest.approx((0.2, 2.5, 0.25))
    assert (settings.samples, settings.light_samples, settings.max_depth) == (2, 33, 3)
    (light,), (material,) = found.lights, [m for m in found.materials if m.name == "Grey"]
    assert not light.soft_shadows
    assert material.Od == pytest.approx((0.5, 0.25, 0.125)) and (material.ks, material.nShiny) == (0, 12.5)
    own = bpy.data.materials["Grey"].light_meshes
    assert tuple(own.mirror) == pytest.approx((0.1, 0.2, 0.3)) and not own.override_mirror
