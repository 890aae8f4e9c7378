"""What addon/build.py writes for other platforms, what it refuses, and what the zips' manifests say.

tests/addon/test_addon_installed.py builds this platform's zip, looks at the wheel in it, and installs it.
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


@pytest.fixture
def quickly(monkeypatch):
    """Compile without optimization. What a library needs of its system does not become less by that, and what is
    released is checked again (CONTRIBUTING.md).
    """
    monkeypatch.setenv("LIGHT_MESHES_CFLAGS", "-O0 -g0 -fno-sanitize=undefined")


@pytest.mark.slow
@pytest.mark.parametrize("other", ["darwin-arm64", "linux-arm64"])
def test_wheels_are_built_for_other_platforms(other, tmp_path, quickly):
    path, said = build.build_wheel(other, tmp_path)
    system, machine = other.split("-")
    assert path.name.endswith(f"-py3-none-{build.TARGETS[other].wheel}.whl")
    assert said.startswith("light_meshes/kernels.") and f": {system} {machine}, needs " in said
    if system == "darwin":  # whose libraries hold their own names; for Linux see tests/addon/test_addon_installed.py
        (tmp_path / "again").mkdir()
        assert build.build_wheel(other, tmp_path / "again")[0].read_bytes() == path.read_bytes()


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
