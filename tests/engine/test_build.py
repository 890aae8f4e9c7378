"""The zips that addon/build.py writes for each platform and Python; test_addon_installed.py installs one."""

import importlib.util
import tomllib
import zipfile
from io import BytesIO
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("build", ROOT / "addon" / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_manifests(build):
    own = tomllib.loads((ROOT / "addon" / "blender_manifest.toml").read_text(encoding="utf-8"))
    ranges = {}
    for platform in ("linux-x64", "windows-x64", "macos-arm64"):
        for python in build.PYTHONS:
            found = tomllib.loads(build.manifest(platform, python, ["a.whl", "b.whl"]))
            assert found["platforms"] == [platform] and found["wheels"] == ["./wheels/a.whl", "./wheels/b.whl"]
            ranges[python.version] = found["blender_version_min"], found.get("blender_version_max")
            assert {k: v for k, v in found.items() if k in own and k != "blender_version_min"} == {
                k: v for k, v in own.items() if k != "blender_version_min"}
    assert ranges == {"3.11": ("4.2.0", "5.1.0"), "3.13": ("4.2.0", None)}


def test_the_engines_wheel_holds_the_engine_alone_and_is_reproducible(build):
    name, data = build.engine_wheel("linux-x64")
    assert (name, data) == build.engine_wheel("linux-x64")
    names = set(zipfile.ZipFile(BytesIO(data)).namelist())
    sources = {p.relative_to(ROOT / "engine").as_posix() for p in (ROOT / "engine").rglob("*.py")}
    sources.add("light_meshes/py.typed")
    info = name.removesuffix("-py3-none-manylinux2014_x86_64.whl") + ".dist-info"
    kernels = {f"light_meshes/{level}.so" for level in ("kernels", "kernels-avx2")}
    assert names == sources | kernels | {f"{info}/{file}" for file in ("METADATA", "WHEEL", "RECORD")}


def test_a_missing_wheel_is_told(build, tmp_path):
    with pytest.raises(build.BuildError, match=r"no wheel of \S+ is to be had for macos-arm64 and Python 3\.6"):
        build.download("macos-arm64", build.Python("3.6", "2.93.0", None), tmp_path)


def test_an_unknown_name(build, tmp_path, capsys):
    assert build.main(["amiga", "-o", str(tmp_path)]) == 1
    assert "there is no amiga; there are linux-x64-py3.11, " in capsys.readouterr().err
