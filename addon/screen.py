"""Drawing into the region of a 3D view: a picture, which is uploaded as a texture, or a sentence instead of it."""

import blf
import gpu
import numpy as np
from gpu_extras.presets import draw_texture_2d


class Picture:
    """The last picture of a 3D view. Call `draw` only from Blender's draw callback; `put` may be called at any time."""

    def __init__(self) -> None:
        self._pixels: np.ndarray | None = None  # pixels that are not on the graphics card yet
        self._texture = None
        self._corners = (0.0, 0.0, 0.0, 0.0)

    def put(self, pixels: np.ndarray, corners: tuple[float, float, float, float]) -> None:
        """Show `pixels` between these corners of the region. They have the shape (h,w,4), are scene-linear and
        premultiplied, and begin with the bottom row.
        """
        self._pixels, self._corners = np.ascontiguousarray(pixels, np.float32), corners

    def clear(self) -> None:
        """Show nothing."""
        self._pixels = self._texture = None

    def draw(self, engine, scene) -> None:
        """Draw the picture, if there is one, through the scene's view transform."""
        if self._pixels is not None:
            height, width = self._pixels.shape[:2]
            buffer = gpu.types.Buffer('FLOAT', self._pixels.size, self._pixels.ravel())
            self._texture = gpu.types.GPUTexture((width, height), format='RGBA32F', data=buffer)
            self._pixels = None
        if self._texture is None:
            return
        x0, y0, x1, y1 = self._corners
        gpu.state.blend_set('ALPHA_PREMULT')
        engine.bind_display_space_shader(scene)
        draw_texture_2d(self._texture, (x0, y0), x1 - x0, y1 - y0)
        engine.unbind_display_space_shader()
        gpu.state.blend_set('NONE')


def sentence(context, text: str) -> None:
    """Draw `text` below the middle of the region, to the right of the toolbar, on as many lines as it needs."""
    region, scale, font = context.region, context.preferences.system.ui_scale, 0
    margin = 20 * scale
    left = margin + max([0, *(r.x + r.width - region.x for r in context.area.regions if r.type == 'TOOLS')])
    blf.size(font, 13 * scale)
    blf.color(font, 1.0, 0.8, 0.5, 1.0)
    blf.position(font, left, 0.4 * region.height, 0)
    blf.word_wrap(font, int(max(region.width - left - margin, 100)))
    for option in (blf.WORD_WRAP, blf.SHADOW):
        blf.enable(font, option)
    blf.shadow(font, 5, 0.0, 0.0, 0.0, 1.0)
    blf.shadow_offset(font, 1, -1)
    blf.draw(font, text)
    for option in (blf.WORD_WRAP, blf.SHADOW):
        blf.disable(font, option)
