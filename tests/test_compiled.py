"""Where compiled kernels are kept, and that it is told when they are compiled: each in a process of its own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from light_meshes.support.kernel_files import KernelFiles

SCRIPT = """
from light_meshes.shadows.meshes import averaging
from light_meshes.support import compiled
compiled.watch(lambda fraction, sentence: print(f"{fraction:.2f} {sentence}"))
print(averaging.falloff(0.5))
print(compiled._folder)
"""


@pytest.fixture
def start():
    """(**environment) → a process that needs one kernel, and says what is compiled, a value, and where kernels are."""
    def go(**environment):
        clean = {k: v for k, v in os.environ.items() if k not in {"LIGHT_MESHES_CACHE", "NUMBA_CACHE_DIR"}}
        return subprocess.Popen([sys.executable, "-P", "-c", SCRIPT], env=clean | environment, stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True)
    return go


@pytest.fixture
def run(start):
    """The same, its lines."""
    def go(**environment):
        process = start(**environment)
        said, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
        return said.splitlines()
    return go


def test_the_folder_of_an_installation_is_private_and_holds_one_version(run, tmp_path):
    root = tmp_path / "installed"
    older = root / "light-meshes" / "0123456789abcdef"
    older.mkdir(parents=True)
    (older / ".made-by-light-meshes").touch()
    *told, value, folder = run(LIGHT_MESHES_CACHE=str(root), NUMBA_CACHE_DIR=str(tmp_path / "elsewhere"))
    assert [str(p) for p in older.parent.iterdir()] == [folder] and not (tmp_path / "elsewhere").exists()
    assert older.with_name(folder.rpartition("/")[2]).stat().st_mode & 0o777 == 0o700
    assert len(told) == 1 and "Compiling kernels (once after an installation): 1 of about" in told[0]
    assert run(LIGHT_MESHES_CACHE=str(root)) == [value, folder]  # nothing to compile any more
    if os.name != "nt":  # what others may write is not loaded
        Path(folder).chmod(0o777)
        *told, _, folder = run(LIGHT_MESHES_CACHE=str(root))
        assert folder == "None" and "each time" in told[0]


def test_only_folders_of_ours_are_removed(run, tmp_path):
    """In a folder that somebody else uses, too, and through no link."""
    parent = tmp_path / "light-meshes"
    for name in ("thesis", "0123456789abcdef", "ours"):
        (parent / name).mkdir(parents=True)
        (parent / name / "file").touch()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for folder in (parent / "ours", elsewhere):
        (folder / ".made-by-light-meshes").touch()
    (parent / "link").symlink_to(elsewhere)
    (parent / "notes.txt").touch()
    *_, folder = run(LIGHT_MESHES_CACHE=str(tmp_path))
    assert {p.name for p in parent.iterdir()} == {"thesis", "0123456789abcdef", "link", "notes.txt", Path(folder).name}
    assert (parent / "thesis" / "file").exists() and (elsewhere / ".made-by-light-meshes").exists()


@pytest.mark.parametrize("damage", ["cut short", "a bit"])
def test_a_damaged_file_is_compiled_anew(run, tmp_path, damage):
    *_, value, folder = run(LIGHT_MESHES_CACHE=str(tmp_path))
    files = [*Path(folder).rglob("*.kernel")]
    assert files
    for file in files:
        content = bytearray(file.read_bytes())
        if damage == "a bit":
            content[len(content) // 2] ^= 1
        file.write_bytes(content[:-9] if damage == "cut short" else content)
    *told, again, _ = run(LIGHT_MESHES_CACHE=str(tmp_path))
    assert told and again == value
    assert run(LIGHT_MESHES_CACHE=str(tmp_path)) == [value, folder]


def test_two_that_compile_at_once(start, run, tmp_path):
    both = [start(LIGHT_MESHES_CACHE=str(tmp_path)) for _ in range(2)]
    assert len({process.communicate(timeout=120)[0].splitlines()[-2] for process in both}) == 1
    assert len(run(LIGHT_MESHES_CACHE=str(tmp_path))) == 2  # nothing is left to compile
    files = [*Path(tmp_path).rglob("*.*")]
    assert {f.suffix for f in files if f.is_file()} <= {".kernel", ".made-by-light-meshes", ""}


def test_each_signature_has_its_own_file(tmp_path):
    """Numba numbers them: of two processes, one could store its code as the other's."""
    for key, code in (("int", "add"), ("float", "fadd")):
        assert KernelFiles(tmp_path, "sum").load(key) is None
        KernelFiles(tmp_path, "sum").save(key, code)
    files = KernelFiles(tmp_path, "sum")
    assert (files.load("int"), files.load("float")) == ("add", "fadd")
    files.flush()
    assert files.load("int") is None
    KernelFiles(tmp_path / "nowhere", "sum").save("int", "add")  # a full disk fails no render either


def test_a_folder_that_cannot_be_written(run, tmp_path):
    (tmp_path / "file").touch()
    *told, _, folder = run(LIGHT_MESHES_CACHE=str(tmp_path / "file"))
    assert folder == "None" and "each time, as there is no private folder to keep them in" in told[0]
