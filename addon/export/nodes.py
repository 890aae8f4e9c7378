"""Reading node trees: what feeds a socket, through groups, reroutes and muted nodes, and its value."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import bpy

from .channels import Asked
from .color import luminance_weights
from .ies import Profiles
from .report import Report, shown
from .values import Triple, Value, dot, is_constant, truncated


def uses_nodes(owner) -> bool:
    """Return whether `owner` (material, world, light) is described by its node tree."""
    if owner.node_tree is None:
        return False
    # From 5.0 on materials and worlds always use their nodes, and asking is deprecated.
    return (bpy.app.version >= (5, 0) and not isinstance(owner, bpy.types.Light)) or owner.use_nodes


UNREAD = object()  # the value of an image that cannot be had, which was said already


class Placed:
    """A node, and the group node whose tree contains it (`outer`); None: it is in the material's own tree. All other
    attributes are those of the node.
    """

    def __init__(self, node: Any, outer: Placed | None) -> None:
        self.node, self.outer = node, outer

    def __getattr__(self, name: str) -> Any:
        return getattr(self.node, name)

    @property
    def key(self) -> tuple:
        """Return a key that differs from that of the same node in another use of its group."""
        return (self.node.as_pointer(), *(self.outer.key if self.outer else ()))


class _Nothing(NamedTuple):
    """In place of a socket: the value 0."""

    default_value: float = 0.0
    type: str = 'VALUE'


_NOTHING = _Nothing()


class Link(NamedTuple):
    """The output that is linked to a socket."""

    from_node: Placed
    from_socket: Any


class Nodes:
    """A node tree, what kind of thing it describes and its name, for warnings, and where warnings go.

    image: (image texture node, UDIM tile) → its number in the snapshot, negative where it cannot be had; None: values
    that differ from place to place are not to be had, as of a lamp.
    """

    def __init__(self, tree, kind: str, owner: str, report: Report,
                 image: Callable[[Placed, int], int] | None = None, asked: Asked | None = None) -> None:
        self.tree, self.kind, self.owner, self._report = tree, kind, owner, report
        self._image = image
        self.uv_map: str | None = None  # that operation "uv" means; "": the mesh's own, None: nothing asks for it
        self.asked = asked or Asked()  # all else that it asks of meshes and instances
        self.pass_index, self.displacement_method = 0, 'BUMP'  # of the material
        self.profiles = Profiles()  # those of the snapshot are put here, if there is one
        self.own: dict[str, Callable[..., Any]] = {}  # nodes that mean something else here, as in lamps
        self.homeless = False  # what has the tree has no space of its own
        self.displaced: Triple | None = None  # its normal by its displacement, which is shown as bumps
        self._values: dict[tuple, Any] = {}  # of outputs that were asked for before
        self._open: set[tuple] = set()  # outputs that are being computed

    def output(self, idname: str) -> Placed | None:
        """Return the output node that Cycles takes, or None."""
        node = self.tree.get_output_node('CYCLES')
        if node and node.mute and bpy.app.version < (5, 0):
            return None  # then Cycles has nothing of it
        return Placed(node, None) if node and node.bl_idname == idname else None

    def source(self, node, socket) -> Placed | None:
        """Return the node that feeds input `socket` of `node`; None where nothing does."""
        link = self.link(node, socket)
        return link.from_node if link else None

    def link(self, node, socket) -> Link | None:
        """Return the link that feeds input `socket` (name, position or the socket) of `node`, or None.

        Reroutes and muted nodes are passed; groups are entered and left.
        """
        return self._resolved(node, socket)[0] if node is not None else None

    def _resolved(self, node: Placed, socket) -> tuple[Link | None, Any, list[str]]:
        """Return the link that feeds an input, or None and the socket whose own value counts then; and the types of
        sockets that values become on their way, the last one first.
        """
        socket, outer = self.input(node, socket), node.outer
        becomes: list[str] = []
        asking = socket  # the one whose own value counts, also where a muted node is passed whose input has no link
        before: list[str] = []  # what its value becomes
        while socket is not None and socket.is_linked:
            link = socket.links[0]
            if link.is_muted:
                return None, socket, becomes
            inner = link.from_node
            following = None
            if inner.bl_idname == 'NodeReroute':
                following = inner.inputs[0]
            elif inner.mute:
                following = next((i.from_socket for i in inner.internal_links if i.to_socket == link.from_socket), None)
                if following is None:
                    return None, asking, before
                if bpy.app.version < (5, 0):  # then Cycles makes what it hands on the output's type
                    becomes.append(link.from_socket.type)
            elif inner.bl_idname == 'NodeGroupInput':
                if outer is None:
                    return None, link.from_socket, becomes
                following = _identified(outer.inputs, link.from_socket)
                outer = outer.outer
                becomes += _made_of(following)
            elif inner.bl_idname == 'ShaderNodeGroup':
                end = _group_output(inner.node_tree)
                following = _identified(end.inputs, link.from_socket) if end else None
                if following is None:
                    return None, link.from_socket, becomes
                outer = Placed(inner, outer)
                becomes += _made_of(following)
            else:
                return Link(Placed(inner, outer), link.from_socket), socket, becomes
            if following is None:
                return None, socket, becomes
            socket = following
            if not inner.mute:
                asking, before = socket, [*becomes]
        if socket is not asking and bpy.app.version < (5, 0):
            return None, _NOTHING, []  # then what a muted node hands on without a link is 0 in Cycles
        return None, asking, before

    def image(self, node: Placed, tile: int = 0) -> int:
        """Return the number of an image texture node's image, or of its UDIM tile; negative where it cannot be had."""
        return self._image(node, tile) if self._image else -1

    def color(self, node, socket) -> Triple:
        """Return the colour of an input."""
        return self._as_triple(*self._typed(node, socket))

    def vector(self, node, socket) -> Triple:
        """Return the vector of an input: the numbers of a colour, too."""
        return self._as_triple(*self._typed(node, socket))

    def value(self, node, socket) -> Value:
        """Return the number of an input: of a colour its luminance, of a vector the mean, as Cycles converts."""
        return self._as_number(*self._typed(node, socket))

    @staticmethod
    def _as_number(value: Any, kind: str) -> Value:
        if kind == 'RGBA':
            return dot(value, luminance_weights())
        return (value[0] + value[1] + value[2]) / 3.0 if isinstance(value, tuple) else value

    @staticmethod
    def _as_triple(value: Any, kind: str) -> Triple:
        return value if isinstance(value, tuple) else (value, value, value)

    @staticmethod
    def input(node, socket):
        """Return the input of `node` with that name, identifier or position; None where there is none."""
        if not isinstance(socket, str | int):
            return socket
        if isinstance(socket, int):
            return node.inputs[socket]
        first = node.inputs.get(socket)
        if first is None or not first.is_unavailable:
            return first
        # Of several inputs with one name (Mix, Map Range) the one in use is meant.
        named = [s for s in node.inputs if s.name == socket and not s.is_unavailable]
        return named[0] if named else first

    def warn(self, sentence: str, used: str = "") -> None:
        """Warn; `used`: the value that was used instead."""
        self._report.warn(sentence, self.kind, self.owner, used)

    def not_translated(self, node, instead: str, used: str = "") -> None:
        """Warn that `node` means nothing to the engine, what is done instead, and the value that is used."""
        name = self.plain_name(node)
        label = f"'{name}'" if name == node.bl_label else f"'{name}' ({node.bl_label})"
        self.warn(f"node {label} is not translated; {instead}", used)

    @staticmethod
    def plain_name(node) -> str:
        """Return the node's name, without the number that Blender gives to a second one of its type."""
        return re.sub(r"\.\d{3,}$", "", node.name)

    def _typed(self, node, socket) -> tuple[Any, str]:
        """Return an input's value, a number or a triple, and the type of socket that it comes from."""
        socket = self.input(node, socket)
        if socket is None:
            return 0.0, 'VALUE'  # an input that other choices of the node have
        link, last, becomes = self._resolved(node, socket)
        value, kind = (plain(last), last.type) if link is None else self._linked(link, node, socket)
        if link and bpy.app.version >= (5, 0):
            return value, kind  # then groups change sockets' own values only
        for become in reversed(becomes):
            if become in ('RGBA', 'VECTOR'):
                value = self._as_triple(value, kind)
            else:
                value = self._as_number(value, kind)
                if become in ('INT', 'BOOLEAN'):
                    value = truncated(value)
            kind = become
        return value, kind

    def _linked(self, link: Link, node, socket) -> tuple[Any, str]:
        """Return the value of the output of a link that feeds `socket` of `node`, and its type."""
        found = self._evaluated(link)
        if found is UNREAD:
            return plain(socket), socket.type
        if found is None or (self._image is None and not constant(found)):
            from .node_means import mean  # which reads inputs by this class

            value = mean(self, link.from_node, link.from_socket)
            if value is not None and (self._image is not None or constant(value)):
                self.not_translated(link.from_node, f"its mean is used in '{socket.name}' of "
                                    f"'{self.plain_name(node)}'", shown(value) if constant(value) else "")
                return value, link.from_socket.type
            value = plain(socket)
            self.not_translated(link.from_node, f"the value in '{socket.name}' of '{self.plain_name(node)}' is used",
                                shown(value))
            return value, socket.type
        return found, link.from_socket.type

    def _evaluated(self, link: Link) -> Any:
        """Return the value of an output; None where its node is not translated, or where links run in a circle."""
        from .node_values import evaluate  # which reads inputs by this class

        key = (*link.from_node.key, link.from_socket.identifier)
        if key in self._open:
            return None
        if key not in self._values:
            self._open.add(key)
            try:
                self._values[key] = evaluate(self, link.from_node, link.from_socket)
            finally:
                self._open.discard(key)
        return self._values[key]


def _made_of(socket: Any) -> list[str]:
    """Return what a value becomes that goes through an input or output of a group: of its type."""
    return [socket.type] if socket is not None and socket.type in _TYPES else []


_TYPES = {'VALUE', 'INT', 'BOOLEAN', 'RGBA', 'VECTOR'}


def plain(socket) -> Any:
    """Return a socket's own value: a float, or a tuple of three; 0 for sockets that have none."""
    value = getattr(socket, "default_value", 0.0)
    if isinstance(value, str) or value is None:
        return 0.0
    if isinstance(value, int | float):
        return float(value)
    return tuple(list(value)[:3])


def constant(*values: Value) -> bool:
    """Return whether all these values and triples are numbers."""
    return all(is_constant(*(v if isinstance(v, tuple) else (v,))) for v in values)


def _identified(sockets, other):
    """Return the socket with the identifier of `other`."""
    return next((s for s in sockets if s.identifier == other.identifier), None)


def _group_output(tree):
    """Return the output node of a group's tree that counts."""
    ends = [n for n in tree.nodes if n.bl_idname == 'NodeGroupOutput'] if tree else []
    return next((n for n in ends if n.is_active_output), ends[0] if ends else None)
