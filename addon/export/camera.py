"""The camera, its lens, and which part of its frame is rendered."""

import numpy as np

from .report import ExportError, Report


def frame(engine, scene, depsgraph, report: Report) -> dict:
    """The engine's description of the camera."""
    camera = engine.camera_override or scene.camera
    if camera is None:
        raise ExportError("There is no active camera: add a camera, or make one active (Ctrl Numpad 0)")
    camera = camera.evaluated_get(depsgraph)
    width, height = engine.resolution_x, engine.resolution_y
    matrix = np.array(camera.matrix_world, np.float64)
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if not np.isfinite(matrix).all() or not scale.all():
        raise ExportError(f"Camera '{camera.name}' is scaled to 0, or its place is no number: clear its scale (Alt S), "
                          "and look at its constraints and drivers")
    matrix[:3, :3] /= scale  # a camera's scale does not matter to its picture
    result = {
        "matrix": matrix.tolist(),
        "width": width,
        "height": height,
        "crop": border(scene.render, width, height),
    }
    if camera.type != 'CAMERA':
        # Blender lets any object be the camera and then sees through a default one.
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
    """The lens that blurs what is out of focus, with Cycles' numbers."""
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
    # The focal length is in millimetres, whatever the scene's units; an orthographic camera has none.
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
    """Left, right, bottom, top of the frame at distance 1, or in scene units where orthographic."""
    # Pixels may be oblong: all in units of a pixel's width.
    tall = height * render.pixel_aspect_y / render.pixel_aspect_x
    horizontal = lens.sensor_fit == 'HORIZONTAL' or (lens.sensor_fit == 'AUTO' and width >= tall)
    across = width if horizontal else tall  # the side that the lens was made for
    if lens.type == 'ORTHO':
        size = lens.ortho_scale
    else:
        # With AUTO the width counts on both sides, as in Blender.
        size = (lens.sensor_height if lens.sensor_fit == 'VERTICAL' else lens.sensor_width) / lens.lens
    pixel = size / across
    x, y = shift_x * size, shift_y * size
    return [x - width * pixel / 2, x + width * pixel / 2, y - tall * pixel / 2, y + tall * pixel / 2]


def border(render, width: int, height: int) -> list[int] | None:
    """x0, y0, x1, y1 of the render border in pixels, or None for the whole frame."""
    if not render.use_border:
        return None
    # In float32 and cut off, as Blender does, or the picture would not fit.
    corners = np.array([render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y],
                       np.float32) * np.array([width, height] * 2, np.float32)
    x0, y0, x1, y1 = (int(c) for c in corners)
    if x0 >= x1 or y0 >= y1:
        raise ExportError("The render border is smaller than a pixel: draw a larger one, or switch it off")
    return [x0, y0, x1, y1]
