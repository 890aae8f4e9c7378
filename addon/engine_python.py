"""Which Python runs the engine, and the command and the environment that start it. This module does not use Blender.

Nothing in the current folder is run or searched, because a scene's folder may come from anywhere.
"""

import compileall
import errno
import importlib.machinery
import importlib.util
import os
import re
import shutil
import sys
from pathlib import Path

MODULE = "light_meshes.frontends.service"
# Remove the current folder, which Python's -m puts first in the path: nothing in it may be run. This works in every
# Python; the option -P does not.
_START = f"import sys; sys.path[:] = [p for p in sys.path if p]; import runpy; runpy.run_module({MODULE!r}, " \
    "run_name='__main__')"
# Blender's own Python searches for packages where Blender does. With only Blender's path it finds the packages of
# extensions, and none that the user has for another Python.
_OWN_START = f"import sys; sys.path[:] = dict.fromkeys(sys.argv[1:] + sys.path); {_START}"

_python = ""
_installed = False
_temporary = ""


def set_python(python: str) -> None:
    """Remember the Python that the artist chose; an empty string means Blender's own."""
    global _python
    _python = python


def chosen() -> str:
    """Return the Python that runs the engine."""
    return os.environ.get("LIGHT_MESHES_PYTHON") or _python or sys.executable


def set_installed(installed: bool) -> None:
    """Remember whether the add-on was installed from a zip, which contains the engine as well."""
    global _installed
    _installed = installed


def compile_modules() -> None:
    """Compile the engine's modules, if they came with the add-on and are not compiled yet.

    It takes about a third of a second, once after the installation. Otherwise Python would do the same while the first
    picture is rendered, which would take longer than all others.
    """
    if not _installed or chosen() != sys.executable or sys.dont_write_bytecode:
        return
    for name in ("light_meshes", "embreex"):
        found = importlib.machinery.PathFinder.find_spec(name, _paths())
        if not found or not found.origin:
            continue  # an engine that cannot start says so when it is asked for
        source, compiled = Path(found.origin), Path(importlib.util.cache_from_source(found.origin))
        fresh = compiled.exists() and compiled.stat().st_mtime >= source.stat().st_mtime
        if not fresh and os.access(source.parent, os.W_OK):
            compileall.compile_dir(source.parent, quiet=2)


def temporary() -> str:
    """Return the folder in which new engines make their folders; an empty string means the system's."""
    return _temporary


def set_temporary(folder: str) -> None:
    """Remember the folder in which new engines make their folders; it is the one in Blender's preferences."""
    global _temporary
    _temporary = folder


def command(python: str) -> list[str]:
    if python != sys.executable:
        return [_program(python), "-c", _START]
    return [python, "-I", "-c", _OWN_START, *_paths()]


def _paths() -> list[str]:
    """Return the folders in which Blender's own Python finds packages. The current one is left out, unless PYTHONPATH
    names it.
    """
    named, here = _python_path(), os.path.realpath(_current_folder())
    paths = [p for p in sys.path if p and Path(p).exists() and (p in named or os.path.realpath(p) != here)]
    return [str(Path(p).absolute()) for p in paths]


def _program(name: str) -> str:
    """Return the full path of the program `name`. A program in the current folder is found only if its path is
    given.
    """
    if Path(name).name != name:
        return name
    for folder in os.get_exec_path():
        found = Path(folder).is_absolute() and shutil.which(str(Path(folder, name)))
        if found:
            return found
    raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))


def _current_folder() -> str:
    try:
        return os.getcwd()  # noqa: PTH109
    except OSError:  # the folder was removed
        return ""


def _python_path() -> list[str]:
    """Return the folders in PYTHONPATH, without empty entries and ".", which would mean the current folder."""
    return [p for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p and os.path.normpath(p) != os.curdir]


def environment() -> dict[str, str]:
    found = os.environ | {"PYTHONPATH": os.pathsep.join(_python_path())}  # an empty value counts as not set
    if _temporary:
        found["TMPDIR"] = _temporary  # also on Windows this comes before TEMP
    return found


def lacks_package(python: str, text: str) -> str:
    """Return the sentence for a missing package if `text` reports a failed import, and an empty string otherwise."""
    found = re.search(r"No module named '?([\w.]+)'?", text)
    if not found:
        return ""
    how = f"Install the engine with '{python} -m pip install light-meshes'"
    if _installed and python == sys.executable:
        how = f"Install the add-on's zip for this system and Python {sys.version_info[0]}.{sys.version_info[1]}"
    return (f"The Light Meshes engine cannot start: {python} has no package '{found[1].split('.')[0]}'. {how}, "
            "or choose another Python in the add-on's preferences")
