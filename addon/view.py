"""The view of a 3D view: the engine's camera, and the place of its picture in the region."""

import math
from typing import NamedTuple

import numpy as np

from .export import Report, camera


class Final:
    """The attributes of a render engine that `camera.frame` needs, for the picture that a render through camera `eye`
    would give.
    """

    def __init__(self, scene, eye=None) -> None:
        self.camera_override = eye
        render = scene.render
        self.resolution_x = max(1, render.resolution_x * render.resolution_percentage // 100)
        self.resolution_y = max(1, render.resolution_y * render.resolution_percentage // 100)


class View(NamedTuple):
    """A camera in the form of the engine's `view` command, and the corners of its picture in pixels of the region."""

    camera: dict
    corners: tuple[float, float, float, float]  # x0, y0, x1, y1


def current(context, scene, depsgraph) -> View | None:
    """Return the view of the region that is being drawn, or None if a render border leaves nothing visible."""
    region, space, view = context.region, context.space_data, context.region_data
    size = pixel_size(context, scene)
    # Use whole pixels of the picture; the last ones may reach beyond the region.
    width, height = math.ceil(region.width / size), math.ceil(region.height / size)
    # These formulas are Blender's own for its overlays: in a camera's view, where the frame may be moved or zoomed, and
    # in all other views.
    projection = np.array(view.window_matrix, np.float64)
    perspective = bool(view.is_perspective)
    offset = projection[:2, 2] if perspective else -projection[:2, 3]
    low, high = (offset - 1) / projection.diagonal()[:2], (offset + 1) / projection.diagonal()[:2]
    unit = (high - low) / (region.width, region.height)  # size of a pixel of the region
    high = low + unit * size * (width, height)
    matrix = np.linalg.inv(np.array(view.view_matrix, np.float64))
    matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)
    matrix[3] = 0, 0, 0, 1
    eye = (space.camera if space.use_local_camera else scene.camera) if view.view_perspective == 'CAMERA' else None
    crop = None
    rectangle = _border(space, scene, region, eye, depsgraph, low, unit)
    if rectangle is not None:
        edges = np.clip(np.round(rectangle / size), 0, (width, height, width, height)).astype(int)
        crop = edges.tolist()
        if crop[0] >= crop[2] or crop[1] >= crop[3]:
            return None
    seen = eye and eye.evaluated_get(depsgraph)
    near, far = _clip(space, seen, perspective)
    lens = camera.depth_of_field(seen, seen.data, depsgraph) if seen and seen.type == 'CAMERA' else {}
    x0, y0, x1, y1 = crop or (0, 0, width, height)
    return View({
        "matrix": matrix.tolist(), "window": [low[0], high[0], low[1], high[1]], "width": width, "height": height,
        "perspective": perspective, "clip_start": near, "clip_end": far, "crop": crop,
    } | lens, (x0 * size, y0 * size, x1 * size, y1 * size))


def pixel_size(context, scene) -> int:
    """Return how many pixels of the screen one pixel of the picture has along a side."""
    chosen = scene.render.preview_pixel_size
    if chosen != 'AUTO':
        return int(chosen)
    return 2 if context.preferences.system.pixel_size > 1.5 else 1


def _clip(space, eye, perspective: bool) -> tuple[float, float]:
    if eye and eye.type == 'CAMERA':
        return eye.data.clip_start, eye.data.clip_end
    if perspective:
        return space.clip_start, space.clip_end
    # an orthographic view has no eye point, so it also sees what is behind it
    return -space.clip_end / 2, space.clip_end / 2


def _border(space, scene, region, eye, depsgraph, low, unit) -> np.ndarray | None:
    """Return x0, y0, x1, y1 of the render border in pixels of the region, or None if there is no border."""
    render = scene.render
    if eye:
        if not render.use_border:
            return None
        left, right, bottom, top = camera.frame(Final(scene, eye), scene, depsgraph, Report())["window"]
        x = left + (right - left) * np.array([render.border_min_x, render.border_max_x])
        y = bottom + (top - bottom) * np.array([render.border_min_y, render.border_max_y])
        x, y = (x - low[0]) / unit[0], (y - low[1]) / unit[1]
    elif space.use_render_border:
        x = region.width * np.array([space.render_border_min_x, space.render_border_max_x])
        y = region.height * np.array([space.render_border_min_y, space.render_border_max_y])
    else:
        return None
    return np.array([x[0], y[0], x[1], y[1]])
