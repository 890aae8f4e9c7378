"""Colours: the scene's linear light (its working space), and conversions to it from other spaces."""

import os
from functools import cache
from pathlib import Path

import bpy
import numpy as np
from mathutils import Color

IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
# Linear spaces in Blender's own configuration that Blender itself can convert. Colour pickers use Rec.709.
_LINEAR = {
    "Linear Rec.709": "from_rec709_linear_to_scene_linear",
    "Linear": "from_rec709_linear_to_scene_linear",  # its name before 4.0
    "Linear Rec.2020": "from_rec2020_linear_to_scene_linear",
    "ACEScg": "from_acescg_to_scene_linear",
    "ACES2065-1": "from_aces_to_scene_linear",
    "Linear CIE-XYZ D65": "from_xyz_d65_to_scene_linear",
}


def space(settings) -> dict:
    """Return what the engine's Image stores about a colour space, for an image's `colorspace_settings`."""
    name = settings.name
    # A file that Blender itself cannot read has no name there, and Cycles takes it as it is.
    if settings.is_data or name in {"", "scene_linear", working_space()}:
        return {"colorspace": 'LINEAR'}
    own = not os.environ.get("OCIO")  # in another configuration the same names may mean other spaces
    if own and name == 'sRGB':
        return {"colorspace": 'sRGB', "matrix": _matrix("from_rec709_linear_to_scene_linear")}
    if own and hasattr(Color, _LINEAR.get(name, " ")):
        return {"colorspace": 'LINEAR', "matrix": _matrix(_LINEAR[name])}
    return {"colorspace": name, "ocio": _configuration(), "working_space": working_space()}


def to_rec709() -> list[list[float]]:
    """Return the matrix (list of rows) from the scene's linear light to linear Rec.709."""
    return _matrix("from_scene_linear_to_rec709_linear")


def from_xyz() -> list[list[float]]:
    """Return the matrix, rows, from CIE XYZ with white at D65 to the scene's linear light."""
    return _matrix("from_xyz_d65_to_scene_linear")


def working_space() -> str:
    """Return the configuration's name for the scene's linear light."""
    found = getattr(bpy.data, "colorspace", None)  # 5.0+
    return found.working_space if found and not os.environ.get("OCIO") else "scene_linear"


def luminance_weights() -> tuple[float, float, float]:
    """Return how much each channel of the scene's linear light adds to the Y of a colour."""
    red, green, blue = (Color(one).from_scene_linear_to_xyz_d65()[1] for one in IDENTITY)
    return red, green, blue


def _matrix(method: str) -> list[list[float]]:
    """Return the matrix (list of rows) of a conversion method of Blender's Color."""
    rows = np.array([getattr(Color(one), method)() for one in IDENTITY], np.float64).T
    # Before 5.0, Blender's matrices come from rounded numbers, so the identity must be given exactly.
    return IDENTITY if np.abs(rows - IDENTITY).max() < 1e-4 else rows.tolist()


def _configuration() -> str:
    """Return the file of the OpenColorIO configuration that Blender uses."""
    return os.environ.get("OCIO") or _blenders_own()


@cache
def _blenders_own() -> str:
    return str(Path(bpy.utils.system_resource('DATAFILES', path="colormanagement")) / "config.ocio")
