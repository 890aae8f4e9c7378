"""Export the camera, its lens, and the part of its frame that is rendered."""

import numpy as np

from .report import ExportError, Report


def frame(engine, scene, depsgraph, report: Report) -> dict:
    """Return the camera in the engine's description."""
    camera = engine.camera_override or scene.camera
    if camera is None:
        raise ExportError("There is no active camera: add a camera, or make one active (Ctrl Numpad 0)")
    camera = camera.evaluated_get(depsgraph)
    width, height = engine.resolution_x, engine.resolution_y
    matrix = np.array(camera.matrix_world, np.float64)
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if not np.isfinite(matrix).all() or not scale.all():
        raise ExportError(f"Camera '{camera.name}' is scaled to 0, or its location is not a number: clear its scale "
                          "(Alt S), and look at its constraints and drivers")
    matrix[:3, :3] /= scale  # the scale of a camera does not change its picture
    result = {
        "matrix": matrix.tolist(),
        "width": width,
        "height": height,
        "crop": border(scene.render, width, height),
    }
    if camera.type != 'CAMERA':
        # Blender lets any object be the camera; if it is no camera, Blender uses a default one.
        result |= {"window": _window(scene.render, width, height, _DefaultLens, 0.0, 0.0)}
        return result
    lens = camera.data
    if lens.type not in {'PERSP', 'ORTHO'}:
        report.warn(f"its type {lens.type.lower()} is not translated: rendered as a perspective camera", "Camera",
                    camera.name)
    return result | depth_of_field(camera, lens, depsgraph) | {
        "window": _window(scene.render, width, height, lens, lens.shift_x, lens.shift_y),
        "perspective": lens.type != 'ORTHO',
        "clip_start": lens.clip_start,
        "clip_end": lens.clip_end,
    }


def depth_of_field(camera, lens, depsgraph) -> dict:
    """Return the lens settings that blur things out of focus, with the same numbers as Cycles."""
    dof = lens.dof
    if not dof.use_dof:
        return {}
    focus = dof.focus_distance
    if dof.focus_object:
        target = dof.focus_object.evaluated_get(depsgraph)
        matrix = target.matrix_world
        bone = target.pose.bones.get(dof.focus_subtarget) if target.pose else None
        if bone:
            matrix = matrix @ bone.matrix
        view = camera.matrix_world
        focus = abs(view.col[2].xyz.normalized().dot(matrix.translation - view.translation))
    # The focal length is in millimetres, whatever the scene's units are. An orthographic camera has no focal length.
    length = 1.0 if lens.type == 'ORTHO' else lens.lens / 1000
    return {
        "lens_radius": length / (2 * max(dof.aperture_fstop, 1e-5)),
        "focus_distance": max(focus, 1e-5),
        "lens_blades": dof.aperture_blades,
        "lens_rotation": dof.aperture_rotation,
        "lens_ratio": dof.aperture_ratio,
    }


class _DefaultLens:
    type = 'PERSP'
    sensor_fit = 'AUTO'
    sensor_width = 36.0
    sensor_height = 24.0
    lens = 50.0


def _window(render, width: int, height: int, lens, shift_x: float, shift_y: float) -> list[float]:
    """Return left, right, bottom and top of the frame at distance 1; for an orthographic camera in scene units."""
    # Pixels may be oblong, so all lengths here are in units of a pixel's width.
    tall = height * render.pixel_aspect_y / render.pixel_aspect_x
    horizontal = lens.sensor_fit == 'HORIZONTAL' or (lens.sensor_fit == 'AUTO' and width >= tall)
    across = width if horizontal else tall  # the side to which the lens refers
    if lens.type == 'ORTHO':
        size = lens.ortho_scale
    else:
        # With AUTO the sensor's width is used for both sides, as in Blender.
        size = (lens.sensor_height if lens.sensor_fit == 'VERTICAL' else lens.sensor_width) / lens.lens
    pixel = size / across
    x, y = shift_x * size, shift_y * size
    return [x - width * pixel / 2, x + width * pixel / 2, y - tall * pixel / 2, y + tall * pixel / 2]


def border(render, width: int, height: int) -> list[int] | None:
    """Return x0, y0, x1, y1 of the render border in pixels, or None if the whole frame is rendered."""
    if not render.use_border:
        return None
    # Use float32 and truncate, as Blender does; otherwise the size of the picture would differ.
    corners = np.array([render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y],
                       np.float32) * np.array([width, height] * 2, np.float32)
    x0, y0, x1, y1 = (int(c) for c in corners)
    if x0 >= x1 or y0 >= y1:
        raise ExportError("The render border is smaller than a pixel: draw a larger one, or switch it off")
    return [x0, y0, x1, y1]
