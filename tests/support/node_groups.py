"""Groups and other wiring of node trees, and Blender's own groups, as cells of a sheet: any bpy runs this."""

from pathlib import Path

import bpy
from node_catalogue import feed, slope


def group(name, inputs, outputs):
    """Return a new group's tree, its input node and its output node; inputs and outputs: [(name, type, value)]."""
    tree = bpy.data.node_groups.new(name, 'ShaderNodeTree')
    for kind, sockets in (('INPUT', inputs), ('OUTPUT', outputs)):
        for label, socket, value in sockets:
            made = tree.interface.new_socket(label, in_out=kind, socket_type=f"NodeSocket{socket}")
            if value is not None:
                made.default_value = value
    return tree, tree.nodes.new('NodeGroupInput'), tree.nodes.new('NodeGroupOutput')


def used(tree, inside, inputs=None):
    """Return a node of a group, with its inputs given."""
    node = tree.tree.nodes.new('ShaderNodeGroup')
    node.node_tree = inside
    for key, value in (inputs or {}).items():
        if isinstance(value, bpy.types.NodeSocket):
            tree.tree.links.new(value, node.inputs[key])
        else:
            node.inputs[key].default_value = value
    return node


def _nested(tree, given):
    """Return a group in a group: some inputs are given, some have their own values, one output has nothing."""
    inner, a, b = group(
        "Inner", [("A", "Float", 0.3), ("B", "Vector", (0.1, 0.2, 0.3)), ("C", "Color", (1, 0.5, 0, 1))],
        [("Sum", "Vector", (0.7, 0.8, 0.9)), ("Left", "Color", (0.2, 0.4, 0.6, 1)), ("Number", "Float", 0.6)])
    scale = inner.nodes.new('ShaderNodeVectorMath')
    scale.operation = 'SCALE'
    inner.links.new(a.outputs["B"], scale.inputs[0])
    inner.links.new(a.outputs["A"], scale.inputs[3])
    add = inner.nodes.new('ShaderNodeVectorMath')
    inner.links.new(scale.outputs[0], add.inputs[0])
    inner.links.new(a.outputs["C"], add.inputs[1])
    inner.links.new(add.outputs[0], b.inputs["Sum"])
    outer, c, d = group("Outer", [("X", "Vector", (0.5, 0.1, 0.2)), ("Y", "Float", 0.4)], [("Z", "Vector", None)])
    first, second = outer.nodes.new('ShaderNodeGroup'), outer.nodes.new('ShaderNodeGroup')
    first.node_tree = second.node_tree = inner
    outer.links.new(c.outputs["X"], first.inputs["B"])
    outer.links.new(c.outputs["Y"], second.inputs["A"])
    outer.links.new(first.outputs["Sum"], second.inputs["B"])
    outer.links.new(first.outputs["Left"], second.inputs["C"])
    together = outer.nodes.new('ShaderNodeVectorMath')
    outer.links.new(second.outputs["Sum"], together.inputs[0])
    outer.links.new(first.outputs["Number"], together.inputs[1])
    outer.links.new(together.outputs[0], d.inputs["Z"])
    return used(tree, outer, given).outputs["Z"]


def structures():
    """Cases of how nodes are put together: groups, reroutes, sockets of other types, what has no input."""
    def slopes(tree):
        parts = [slope(tree, -0.5, 1.2, j, False) for j in range(3)]
        return tree.node('ShaderNodeCombineXYZ', dict(enumerate(parts))).outputs[0]

    def rerouted(tree):
        last = slopes(tree)
        for _ in range(3):
            reroute = tree.tree.nodes.new('NodeReroute')
            tree.tree.links.new(last, reroute.inputs[0])
            last = reroute.outputs[0]
        return last

    def dangling(tree):
        reroute = tree.tree.nodes.new('NodeReroute')
        return tree.node('ShaderNodeVectorMath', {0: reroute.outputs[0], 1: (0.3, 0.5, 0.7)}).outputs[0]

    def muted_group(tree):
        node = _nested(tree, {"X": slopes(tree)}).node
        node.mute = True
        return node.outputs["Z"]

    def empty_group(tree):
        inside, _, _ = group("Empty", [("X", "Float", 0.5)], [("Z", "Float", 0.25)])
        return used(tree, inside).outputs["Z"]

    def no_tree(tree):
        node = tree.tree.nodes.new('ShaderNodeGroup')
        return tree.node('ShaderNodeVectorMath', {0: slopes(tree)}).outputs[0] if not node.outputs else node.outputs[0]

    def muted_in_group(tree):
        inside, a, b = group("Muted", [("X", "Color", (0.2, 0.5, 0.8, 1))], [("Z", "Color", None)])
        invert = inside.nodes.new('ShaderNodeInvert')
        invert.mute = True
        inside.links.new(a.outputs[0], invert.inputs["Color"])
        inside.links.new(invert.outputs[0], b.inputs[0])
        return used(tree, inside, {"X": slopes(tree)}).outputs["Z"]

    def framed(tree):
        last = slopes(tree).node
        last.parent = tree.tree.nodes.new('NodeFrame')
        return last.outputs[0]

    def converted(tree, idname, output=0, then='ShaderNodeMath'):
        """What a number makes of a vector or a colour."""
        vector = slopes(tree)
        node = tree.node(idname, {"Color" if idname == 'ShaderNodeGamma' else 0: vector})
        return tree.node(then, {0: node.outputs[output]}).outputs[0]

    def muted_alone(tree, idname, asks, own):
        """What a muted node hands on that nothing feeds."""
        node = tree.node(f"ShaderNode{idname}")
        node.mute = True
        asking = tree.node(f"ShaderNode{asks}", {0: own})
        tree.tree.links.new(node.outputs[0], asking.inputs[0])
        return asking.outputs[0]

    def muted_link(tree):
        node = tree.node('ShaderNodeMath', {0: slopes(tree), 1: 0.3})
        node.inputs[0].links[0].is_muted = True
        return node.outputs[0]

    def out_of_range(tree):
        return tree.node('ShaderNodeMix', {"Factor": 0.3, "A": slopes(tree), "B": slopes(tree)}, data_type='VECTOR',
                         clamp_factor=False).outputs[1]
    return [("nested, given", lambda tree: _nested(tree, {"X": slopes(tree), "Y": 0.8})),
            ("nested, half given", lambda tree: _nested(tree, {"X": slopes(tree)})),
            ("nested, own values", lambda tree: _nested(tree, {})), ("rerouted", rerouted), ("dangling", dangling),
            ("muted group", muted_group), ("empty group", empty_group), ("no tree", no_tree),
            ("muted in a group", muted_in_group), ("framed", framed), ("muted link", muted_link),
            ("vector to number", lambda tree: converted(tree, 'ShaderNodeVectorMath')),
            ("colour to number", lambda tree: converted(tree, 'ShaderNodeGamma')),
            ("colour to vector", lambda tree: converted(tree, 'ShaderNodeGamma', then='ShaderNodeVectorMath')),
            ("number to vector", lambda tree: converted(tree, 'ShaderNodeMath', then='ShaderNodeVectorMath')),
            ("Mix of vectors", out_of_range),
            ("muted colour alone", lambda tree: muted_alone(tree, "Gamma", "Gamma", (0.4, 0.5, 0.6, 1.0))),
            ("muted number alone", lambda tree: muted_alone(tree, "Math", "Math", 0.4)),
            ("muted number as a vector", lambda tree: muted_alone(tree, "Math", "VectorMath", (0.3, 0.4, 0.5)))]


def assets():
    """Cases of the groups that come with Blender for shaders, each output of each, if this one has some."""
    file = Path(bpy.utils.resource_path('LOCAL')) / "datafiles" / "assets" / "nodes" / "shading_nodes_essentials.blend"
    if not file.exists():
        return []
    with bpy.data.libraries.load(str(file)) as (there, here):
        here.node_groups = list(there.node_groups)
    found = []
    for inside in here.node_groups:
        outputs = [i for i in inside.interface.items_tree if i.item_type == 'SOCKET' and i.in_out == 'OUTPUT']
        for n, output in enumerate(outputs):
            def made(tree, inside=inside, n=n):
                node = used(tree, inside)
                feed(tree, node, 'slopes', 3)
                return node.outputs[n]
            found.append((f"{inside.name} {output.name}", made))
    return found


SHEETS = {"structures": lambda: structures() + assets()}
