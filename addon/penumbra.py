"""What h, kI and r mean in the picture: how wide a shadow's edge is, in the scene's units and in pixels."""

import math

import bpy

from . import session

AUTO_STEPS = 200  # the automatic step is the picture's longer side, where half of what is seen is nearer, over this


def step(scene) -> float | None:
    """h that the scene renders with; None if it is automatic and the scene has not been rendered yet."""
    own = scene.light_meshes
    if not own.auto_h:
        return own.h
    return session.statistics.get("h") if session.statistics.get("scene") == scene.name_full else None


def radius(scene) -> float | None:
    """r = h·kI, of the lights that have none of their own; None if it is still to be measured.

    The automatic step is finer where a light's own radius needs it, but r stays as the camera alone would have it.
    """
    own = scene.light_meshes
    h = _measured(scene) if own.auto_h else own.h
    return None if h is None else h * own.kI


def _measured(scene) -> float | None:
    """The automatic step as the camera alone asks for it."""
    known = session.statistics.get("scene") == scene.name_full
    return (session.statistics.get("measured_h") or None) if known else None


def light_radius(scene, lamp, name: str) -> float | None:
    """r of the light object `name` with data `lamp`; None if it is still to be measured."""
    own = lamp.light_meshes
    if own.softness == 'RADIUS':
        return own.radius
    if own.softness == 'SCENE':
        return radius(scene)
    if session.statistics.get("scene") != scene.name_full:
        return None
    return session.statistics.get("light_radii", {}).get(name)


def nodes(kI: float) -> int:
    """How many nodes a point averages on open ground: those of half a ball."""
    return round(2 * math.pi / 3 * kI**3)


def pixels(scene, r: float | None) -> tuple[float, str] | None:
    """Width in pixels of an edge of radius `r` that the camera faces, and where; None if it cannot be told.

    Where the camera is focused, if it has depth of field; else at the depth that the automatic step is made for;
    else, where the step is set by hand, at the focus distance all the same. An `r` of None is that of the
    automatic step, which needs no measurement to be known in pixels.
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
    """Depth of what the camera is focused on."""
    target = camera.data.dof.focus_object
    if target is None:
        return camera.data.dof.focus_distance
    return -(camera.matrix_world.normalized().inverted() @ target.matrix_world.translation).z


def length(scene, value: float) -> str:
    """`value` in the scene's units, as Blender writes lengths."""
    units = scene.unit_settings
    if units.system == 'NONE':
        return f"{value:.4g}"
    if units.length_unit == 'METERS':
        return f"{value * units.scale_length:.4g} m"
    return bpy.utils.units.to_string(units.system, 'LENGTH', value * units.scale_length, precision=4,
                                     split_unit=units.use_separate)
