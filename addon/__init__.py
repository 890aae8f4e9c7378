"""Light Meshes: a Blender render engine with soft shadows and indirect light, without noise."""

import sys

if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    del sys.path[0]  # remove the current folder from the path when run as a program: nothing in it may be run

from . import everywhere, operators, preferences, properties, render_engine, softness, ui, waiting

# Properties are registered before the operators and panels that use them. The engine comes late, because Blender may
# render as soon as it is registered.
_MODULES = (preferences, properties, softness, everywhere, operators, ui, render_engine, waiting)


def register() -> None:
    for module in _MODULES:
        module.register()


def unregister() -> None:
    for module in reversed(_MODULES):
        module.unregister()
