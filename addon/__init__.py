"""Light Meshes: a Blender render engine with noise-free soft shadows from point lights."""

import sys

if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    del sys.path[0]  # run as a program: nothing of the current folder is run

from . import operators, preferences, properties, render_engine, ui

# Properties before the operators and panels that use them, the engine last: it may render as soon as it is known.
_MODULES = (preferences, properties, operators, ui, render_engine)


def register() -> None:
    for module in _MODULES:
        module.register()


def unregister() -> None:
    for module in reversed(_MODULES):
        module.unregister()
