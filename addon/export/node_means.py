"""What stands for the values of nodes that the engine cannot compute: their mean, where one is known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .node_bumps import given
from .node_inputs import normal

# Of outputs, by name: of Random Per Island and Pointiness the mean; of all else what most surfaces have.
_PLAIN: dict[str, dict[str, Any]] = {
    'ShaderNodeNewGeometry': {"Pointiness": 0.5, "Random Per Island": 0.5},
    'ShaderNodeAmbientOcclusion': {"AO": 1.0},
    'ShaderNodeWireframe': {"Fac": 0.0, "Factor": 0.0},
    'ShaderNodeHairInfo': {"Is Strand": 0.0, "Intercept": 0.0, "Random": 0.5},
    'ShaderNodeParticleInfo': {"Random": 0.5},
    'ShaderNodeTexGabor': {"Value": 0.5},
}
_LIKE: dict[tuple[str, str], Callable] = {
    ('ShaderNodeAmbientOcclusion', "Color"): lambda nodes, node: nodes.color(node, "Color"),
    ('ShaderNodeBevel', "Normal"): lambda nodes, node: given(nodes, node) or normal(),
}


def mean(nodes: Any, node: Any, socket: Any) -> Any:
    """Return the number or the three numbers that stand for an output whose value cannot be had; None: nothing does."""
    like = _LIKE.get((node.bl_idname, socket.name))
    if like:
        return like(nodes, node)
    if node.bl_idname in ('ShaderNodeTexImage', 'ShaderNodeTexEnvironment'):
        return image_mean(node.image, socket.name)
    return _PLAIN.get(node.bl_idname, {}).get(socket.name)


def image_mean(image: Any, output: str) -> Any:
    """Return the mean colour or alpha of an image that Blender can read, in linear light; None: it cannot."""
    if image is None or not all(image.size) or not image.channels:
        return None
    original = image.original
    had = original.has_data
    pixels = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    original.pixels.foreach_get(pixels)
    if not had and not original.is_dirty and image.source != 'GENERATED':
        original.buffers_free()  # nobody looked at it before
    pixels = pixels.reshape(-1, image.channels).astype(np.float64)
    if output == "Alpha":
        return float(pixels[:, 3].mean()) if image.channels == 4 else 1.0
    colors = pixels[:, :3] if image.channels >= 3 else pixels[:, :1].repeat(3, axis=1)
    if not image.is_float and not image.colorspace_settings.is_data:  # bytes are as in files
        colors = np.where(colors <= 0.04045, colors / 12.92, ((np.maximum(colors, 0) + 0.055) / 1.055) ** 2.4)
    red, green, blue = colors.mean(0).tolist()
    return red, green, blue
