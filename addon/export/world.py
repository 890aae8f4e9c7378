"""The world's colour: background and ambient light."""

from .nodes import Nodes, uses_nodes
from .report import Report


def color(world, report: Report) -> list[float]:
    """Radiance of the background; black without a world."""
    if world is None:
        return [0.0, 0.0, 0.0]
    if not uses_nodes(world):
        return list(world.color)
    nodes = Nodes(world.node_tree, f"World '{world.name}'", report)
    return _radiance(nodes, nodes.source(nodes.output('ShaderNodeOutputWorld'), "Surface"))


def _radiance(nodes: Nodes, node) -> list[float]:
    if node is None:
        return [0.0, 0.0, 0.0]
    if node.bl_idname == 'ShaderNodeBackground':
        strength = nodes.value(node, "Strength")
        return [c * strength for c in nodes.color(node, "Color")]
    nodes.not_translated(node, "its background is black")
    return [0.0, 0.0, 0.0]
