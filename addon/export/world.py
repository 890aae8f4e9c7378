"""Export the colour of the world, for background and ambient light."""

from . import left_out
from .nodes import Nodes, uses_nodes
from .report import Report


def color(world, report: Report) -> list[float]:
    """Return the radiance of the background; black without a world."""
    if world is None:
        return [0.0, 0.0, 0.0]
    if not uses_nodes(world):
        return list(world.color)
    nodes = Nodes(world.node_tree, "World", world.name, report)
    output = nodes.output('ShaderNodeOutputWorld')
    volume = nodes.source(output, "Volume")
    if volume is not None:
        nodes.not_translated(volume, "it is rendered without volume")
    return _radiance(nodes, nodes.source(output, "Surface"))


def _radiance(nodes: Nodes, node) -> list[float]:
    if node is None:
        return [0.0, 0.0, 0.0]
    if node.bl_idname == 'ShaderNodeBackground':
        left_out.inputs(nodes, node)
        strength = nodes.value(node, "Strength")
        return [c * strength for c in nodes.color(node, "Color")]
    nodes.not_translated(node, "its background is black")
    return [0.0, 0.0, 0.0]
