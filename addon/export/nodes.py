"""Read node trees: find the node that feeds a socket, or the socket's constant if that node is not translated."""

import re

import bpy

from .color import luminance
from .report import Report, shown


def uses_nodes(owner) -> bool:
    """Return whether `owner` (material, world, light) is described by its node tree."""
    if owner.node_tree is None:
        return False
    # From 5.0 on materials and worlds always use their nodes, and asking is deprecated.
    return (bpy.app.version >= (5, 0) and not isinstance(owner, bpy.types.Light)) or owner.use_nodes


class Nodes:
    """A node tree, with the kind and the name of its owner for warnings, and the Report that collects the warnings."""

    def __init__(self, tree, kind: str, owner: str, report: Report) -> None:
        self.tree, self.kind, self.owner, self._report = tree, kind, owner, report

    def output(self, idname: str):
        """Return the output node that Cycles would use, or None."""
        node = self.tree.get_output_node('CYCLES')
        return node if node and node.bl_idname == idname else None

    def source(self, node, socket):
        """Return the node that feeds input `socket` of `node`, through reroutes; None if there is none."""
        link = self.link(node, socket)
        return link.from_node if link else None

    def link(self, node, socket):
        """Return the link that feeds input `socket` (name or position) of `node`; reroutes and muted nodes are
        skipped.
        """
        if node is None:
            return None
        socket = self.input(node, socket)
        while socket is not None and socket.is_linked:
            link = socket.links[0]
            if link.is_muted:
                return None
            node = link.from_node
            if node.bl_idname == 'NodeReroute':
                socket = node.inputs[0]
            elif node.mute:
                through = [inner.from_socket for inner in node.internal_links if inner.to_socket == link.from_socket]
                socket = through[0] if through else None
            else:
                return link
        return None

    def color(self, node, socket) -> list[float]:
        """Return the constant colour of an input."""
        return list(self._constant(node, socket))[:3]

    def value(self, node, socket) -> float:
        """Return the constant number of an input."""
        value = self._constant(node, socket)
        # If a colour feeds a number, its luminance is used.
        return value if isinstance(value, float) else luminance(value)

    @staticmethod
    def input(node, socket):
        """Return the input of `node` with that name or position."""
        return node.inputs[socket] if isinstance(socket, str | int) else socket

    def warn(self, sentence: str, used: str = "") -> None:
        """Add a warning; `used` is the value that was used instead."""
        self._report.warn(sentence, self.kind, self.owner, used)

    def not_translated(self, node, instead: str, used: str = "") -> None:
        """Warn that the engine cannot translate `node`, with what is done instead and the value that is used."""
        name = self.plain_name(node)
        label = f"'{name}'" if name == node.bl_label else f"'{name}' ({node.bl_label})"
        self.warn(f"node {label} is not translated; {instead}", used)

    @staticmethod
    def plain_name(node) -> str:
        """Return the node's name without the number that Blender gives to further nodes of the same type."""
        return re.sub(r"\.\d{3,}$", "", node.name)

    def _constant(self, node, socket):
        socket = self.input(node, socket)
        link = self.link(node, socket)
        if link is None:
            return _plain(socket.default_value)
        if link.from_node.bl_idname in {'ShaderNodeRGB', 'ShaderNodeValue'}:
            value = _plain(link.from_socket.default_value)
            return [value] * 3 if isinstance(value, float) and socket.type == 'RGBA' else value
        value = _plain(socket.default_value)
        self.not_translated(link.from_node, f"the value in '{socket.name}' of '{self.plain_name(node)}' is used",
                            shown(value))
        return value


def _plain(value):
    return float(value) if isinstance(value, int | float) else list(value)
