"""What addon/build.py writes for each platform: wheels that could be published, and zips for every Blender.

tests/addon/test_addon_installed.py installs a zip.
"""

import importlib.util
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ADDON = ROOT / "addon"


def _load(name):
    spec = importlib.util.spec_from_file_location(name, ADDON / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


build = _load("build")
libraries = sys.modules["libraries"]  # as build imported it, so that its errors are the same classes
HERE = next(name for name, t in build.TARGETS.items() if t.system == sys.platform and name.endswith("x86_64"))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel for this system on x86-64."""
    return build.build_wheel(HERE, tmp_path_factory.mktemp("wheel"))[0]


def test_the_version_stands_in_one_place():
    """Blender reads addon/blender_manifest.toml as it is, so it repeats the version; nothing else does."""
    import light_meshes

    assert build.version() == light_meshes.__version__
    assert tomllib.loads((ADDON / "blender_manifest.toml").read_text("utf-8"))["version"] == light_meshes.__version__
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    assert "version" not in project["project"] and project["project"]["dynamic"] == ["version"]
    assert re.fullmatch(r"\d+\.\d+\.\d+", light_meshes.__version__)  # for Blender, and for a package index


def test_two_versions_are_refused(tmp_path, monkeypatch):
    (tmp_path / "blender_manifest.toml").write_text('version = "9.9.9"\n')
    monkeypatch.setattr(build, "ADDON", tmp_path)
    with pytest.raises(build.BuildError, match=r"blender_manifest.toml has version 9\.9\.9 and"):
        build.version()


def test_manifests():
    own = tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))
    for platform in build.PLATFORMS:
        found = tomllib.loads(build.manifest(platform, ["a.whl", "b.whl"]))
        assert found == own | {"platforms": [platform], "wheels": ["./wheels/a.whl", "./wheels/b.whl"]}


def test_a_zip_is_as_the_extensions_platform_wants_it(tmp_path):
    """No byte code, a website, short sentences without a full stop, and Blender's own check has nothing to say."""
    path = tmp_path / "light_meshes.zip"
    build.write_zip("linux-x64", [], path, "https://example.org/light-meshes")
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        found = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert all(name.endswith((".py", "LICENSE", "blender_manifest.toml")) for name in names)
    assert not [name for name in names if "__pycache__" in name]
    assert found["website"] == "https://example.org/light-meshes" and "Blender" not in found["name"]
    for sentence in (found["tagline"], *found["permissions"].values()):
        assert len(sentence) <= 64 and sentence[-1].isalnum()
    assert build.validate(path) in ("valid", "not validated, as there is neither a bpy nor a blender")
    assert build.main(["--website", "nowhere", "-o", str(tmp_path)]) == 1


def test_the_folder_is_a_valid_extension():
    """As a developer enables it in place, without a zip."""
    bpy = importlib.util.find_spec("bpy")
    if not bpy:
        pytest.skip("no bpy, whose check of extensions this is")
    script = next(Path(bpy.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    done = subprocess.run([sys.executable, script, "validate", ADDON], capture_output=True, text=True)
    assert done.returncode == 0 and "Success" in done.stdout, done.stdout + done.stderr


@pytest.mark.slow
def test_a_wheel_can_be_published_and_is_reproducible(wheel, tmp_path):
    target = build.TARGETS[HERE]
    assert wheel.name == f"light_meshes-{build.version()}-py3-none-{target.wheel}.whl"
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        metadata = archive.read(f"light_meshes-{build.version()}.dist-info/METADATA").decode()
    engine = {p.relative_to(ROOT / "engine").as_posix() for p in (ROOT / "engine").rglob("*.py")}
    addon = {f"light_meshes_addon/{p.relative_to(ADDON).as_posix()}" for p in ADDON.rglob("*.py")
             if p.name not in build.TOOLS}
    kernels = {f"light_meshes/{build.library(target.system, level)}" for level in target.levels}
    assert names == engine | addon | kernels | {"light_meshes/py.typed", "light_meshes_addon/blender_manifest.toml"}
    needs = {re.match(r"[\w-]+", line)[0] for line in re.findall("^Requires-Dist: (.*)$", metadata, re.M)
             if "extra ==" not in line}
    assert needs == {"numpy", "embreex", "OpenImageIO"}
    assert build.build_wheel(HERE, tmp_path)[0].read_bytes() == wheel.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("other", ["darwin-arm64", "linux-arm64"])
def test_wheels_are_built_for_other_platforms(other, tmp_path):
    path, said = build.build_wheel(other, tmp_path)
    system, machine = other.split("-")
    assert path.name.endswith(f"-py3-none-{build.TARGETS[other].wheel}.whl")
    assert said.startswith("light_meshes/kernels.") and f": {system} {machine}, needs " in said


@pytest.mark.slow
def test_what_a_wheel_is_not_is_told(wheel, tmp_path):
    target = build.TARGETS[HERE]
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
        ({"tag": "macosx_11_0_arm64"}, f"is for {target.system} x86_64"),
        ({"libraries_": {"kernels.pyd"}}, "should hold"),
        ({"numba": b""}, "has or needs numba"),
        ({"tag": "manylinux_2_5_x86_64"}, "newer than the tag says") if target.system == "linux" else ({}, None),
    ):
        if says:
            with pytest.raises(libraries.LibraryError, match=re.escape(says)):
                check(**wrong)


def test_what_a_library_may_not_need():
    ok = libraries.Library("linux", "arm64", frozenset({"libc.so.6", "libm.so.6"}), (2, 17), False)
    assert not libraries.complaint(ok, "manylinux2014_aarch64")
    assert "libfoo.so.1" in libraries.complaint(ok._replace(needs=ok.needs | {"libfoo.so.1"}), "manylinux2014_aarch64")
    assert "newer" in libraries.complaint(ok._replace(oldest=(2, 18)), "manylinux2014_aarch64")
    mac = libraries.Library("darwin", "arm64", frozenset({"/usr/lib/libSystem.B.dylib"}), (11, 0), True)
    assert not libraries.complaint(mac, "macosx_11_0_arm64")
    assert "signed" in libraries.complaint(mac._replace(signed=False), "macosx_11_0_arm64")


@pytest.mark.parametrize("data", [b"", b"\x7fELF\x02\x01", b"MZ" + bytes(200), b"\xcf\xfa\xed\xfe", b"!<arch>\n"])
def test_what_is_no_library_is_told(data):
    with pytest.raises(libraries.LibraryError, match="librar"):
        libraries.read(data)


def test_a_missing_package_is_told(tmp_path):
    with pytest.raises(build.BuildError, match=r"no wheel of \S+ is to be had for macos-arm64 and Python 3\.6"):
        build.download("macos-arm64", tmp_path, ("3.6",))


@pytest.mark.parametrize("arguments", [["amiga"], ["--wheels", "linux-x64"]])
def test_an_unknown_name(arguments, tmp_path, capsys):
    assert build.main([*arguments, "-o", str(tmp_path)]) == 1
    known = build.TARGETS if "--wheels" in arguments else build.PLATFORMS
    assert f"there is no {arguments[-1]}; there are {', '.join(known)}" in capsys.readouterr().err
