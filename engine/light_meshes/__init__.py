"""Light Meshes: soft shadows and light from everywhere, without noise (after Debelov et al., 2008).

What a program needs to describe a scene, render it and write the picture is here; docs/python.md shows how. A name is
imported when it is first used: the version costs no time, and a scene's description no more than numpy.
"""

import sys
from typing import TYPE_CHECKING

if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    del sys.path[0]  # remove the current folder from the path when run as a program: nothing in it may be run

__version__ = "0.2.0"

if TYPE_CHECKING:
    from .film.passes import PASSES
    from .frontends.program import Picture, read_snapshot, render, write_snapshot
    from .picture.render import Cancelled
    from .scene.description import Camera, Image, Light, Material, Object, Scene, Settings, Shape
    from .scene.errors import SceneError
    from .scene.geometry import Geometry
    from .scene.mesh import Mesh, box, cylinder, rectangle, sphere
    from .scene.transforms import rotate_x, rotate_y, rotate_z, scale, translate
    from .support.sources import KernelError
else:
    _MODULES = {
        "film.passes": ("PASSES",),
        "frontends.program": ("Picture", "read_snapshot", "render", "write_snapshot"),
        "picture.render": ("Cancelled",),
        "scene.description": ("Camera", "Image", "Light", "Material", "Object", "Scene", "Settings", "Shape"),
        "scene.errors": ("SceneError",),
        "scene.geometry": ("Geometry",),
        "scene.mesh": ("Mesh", "box", "cylinder", "rectangle", "sphere"),
        "scene.transforms": ("rotate_x", "rotate_y", "rotate_z", "scale", "translate"),
        "support.sources": ("KernelError",),
    }

    def __getattr__(name):
        """Import the module that has the object of this name, and return the object."""
        from importlib import import_module

        for module, names in _MODULES.items():
            if name in names:
                found = globals()[name] = getattr(import_module(f".{module}", __name__), name)
                return found
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__():
        """Return all names that the package exports, whether they are imported yet or not."""
        return sorted({*globals(), *__all__})

__all__ = [
    "PASSES",
    "Camera",
    "Cancelled",
    "Geometry",
    "Image",
    "KernelError",
    "Light",
    "Material",
    "Mesh",
    "Object",
    "Picture",
    "Scene",
    "SceneError",
    "Settings",
    "Shape",
    "__version__",
    "box",
    "cylinder",
    "read_snapshot",
    "rectangle",
    "render",
    "rotate_x",
    "rotate_y",
    "rotate_z",
    "scale",
    "sphere",
    "translate",
    "write_snapshot",
]
