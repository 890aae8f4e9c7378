"""What h, kI and r mean in the picture: the width of a shadow's edge, in the scene's units and in pixels."""

import math

import bpy

from . import session
from .softness import softness_of

AUTO_STEPS = 200  # the automatic step is the longer side of the picture at the median depth, divided by this


def step(scene) -> float | None:
    """Return the h that the scene renders with. It is None if the step is automatic and the scene has not been rendered
    yet.
    """
    own = scene.light_meshes
    if not own.auto_h:
        return own.h
    return session.statistics.get("h") if session.statistics.get("scene") == scene.name_full else None


def radius(scene) -> float | None:
    """Return r = h·kI of the lights that have no own radius, or None if it has not been measured yet.

    The automatic step gets finer if a light's own radius needs it, but r stays what the camera alone gives.
    """
    own = scene.light_meshes
    h = _measured(scene) if own.auto_h else own.h
    return None if h is None else h * own.kI


def _measured(scene) -> float | None:
    """Return the automatic step that the camera alone gives, or None if it is not known."""
    known = session.statistics.get("scene") == scene.name_full
    return (session.statistics.get("measured_h") or None) if known else None


def light_radius(scene, lamp, name: str) -> float | None:
    """Return r of the light object `name` with data `lamp`, whose softness is not SIZE, or None if it has not been
    measured yet.
    """
    own, softness = lamp.light_meshes, softness_of(lamp)
    if softness == 'RADIUS':
        return own.radius
    if softness == 'SCENE':
        return radius(scene)
    if session.statistics.get("scene") != scene.name_full:
        return None
    return session.statistics.get("light_radii", {}).get(name)


def nodes(kI: float) -> int:
    """Return how many nodes a point averages on open ground, which is the number of nodes in half a ball."""
    return round(2 * math.pi / 3 * kI**3)


def pixels(scene, r: float | None) -> tuple[float, str] | None:
    """Return the width in pixels of an edge of radius `r` that faces the camera, and where this holds; None if it is
    unknown.

    With depth of field the width is measured where the camera is focused. Otherwise it is measured at the depth for
    which the automatic step is made, or, if the step is set by hand, at the focus distance. An `r` of None stands for
    the radius of the automatic step; its width in pixels is known without a measurement.
    """
    camera = scene.camera
    if camera is None or camera.type != 'CAMERA':
        return None
    lens, render = camera.data, scene.render
    width = render.resolution_x * render.resolution_percentage / 100
    height = render.resolution_y * render.resolution_percentage / 100
    corners = lens.view_frame(scene=scene)
    across = max(c.x for c in corners) - min(c.x for c in corners)
    if lens.type != 'ORTHO':
        across /= -corners[0].z  # at distance 1
    if lens.type == 'ORTHO' and r is not None:
        return 2 * r / across * width, "everywhere"
    if scene.light_meshes.auto_h and (not lens.dof.use_dof or r is None):
        measured = _measured(scene)
        steps = scene.light_meshes.kI if r is None or measured is None else r / measured
        return 2 * steps / AUTO_STEPS * max(width, height), "in the middle of what is seen"
    distance = _focus(camera)
    if r is None or distance <= 0:
        return None
    where = "at the focus" if lens.dof.use_dof else "at the focus distance"
    return 2 * r / (across * distance) * width, f"{where}, {length(scene, distance)}"


def _focus(camera) -> float:
    """Return the depth at which the camera is focused."""
    target = camera.data.dof.focus_object
    if target is None:
        return camera.data.dof.focus_distance
    return -(camera.matrix_world.normalized().inverted() @ target.matrix_world.translation).z


def length(scene, value: float) -> str:
    """Return `value` in the scene's units, as text in Blender's format."""
    units = scene.unit_settings
    if units.system == 'NONE':
        return f"{value:.4g}"
    if units.length_unit == 'METERS':
        return f"{value * units.scale_length:.4g} m"
    return bpy.utils.units.to_string(units.system, 'LENGTH', value * units.scale_length, precision=4,
                                     split_unit=units.use_separate)
