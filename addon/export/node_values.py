"""What an output of a node gives, for all nodes that are no shaders: one table."""

from . import node_bumps, node_colors, node_ies, node_inputs, node_math, node_sky, node_spectra, node_textures

NODES = node_math.NODES | node_colors.NODES | node_inputs.NODES | node_bumps.NODES | (
    node_spectra.NODES | node_textures.NODES | node_sky.NODES | node_ies.NODES)


def evaluate(nodes, node, socket):
    """Return the number, or the three numbers, at output `socket` of `node`; None where it is not translated."""
    translate = nodes.own.get(node.bl_idname) or NODES.get(node.bl_idname)
    return translate(nodes, node, socket) if translate else None
