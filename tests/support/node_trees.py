"""Node trees written down quickly, and their values on a plane in this engine's picture and in Cycles'."""

import bpy
import numpy as np
import pytest


@pytest.fixture
def plane(scene, add_plane):
    """A plane that fills the picture, its UVs from 0 to 1, the render without filter, and Cycles' settings."""
    ob = add_plane(half=1.0)
    layer = ob.data.uv_layers.new(name="UVMap")
    for corner, at in zip(layer.uv, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        corner.vector = at
    scene.camera.data.type, scene.camera.data.ortho_scale = 'ORTHO', 1.96
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.filter_size = 0.0
    scene.light_meshes.samples = 1
    scene.cycles.samples, scene.cycles.filter_width, scene.cycles.use_denoising = 4, 0.01, False  # at pixels' middles
    scene.cycles.use_adaptive_sampling = False
    return ob


class Tree:
    """A material's node tree, written down quickly."""

    def __init__(self, name="Material"):
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()

    def node(self, idname, inputs=None, **properties):
        """A node; inputs by name or position: values, or sockets that are linked."""
        node = self.tree.nodes.new(idname)
        for name, value in properties.items():
            setattr(node, name, value)
        for key, value in (inputs or {}).items():
            socket = node.inputs[key] if isinstance(key, int) else next(
                s for s in node.inputs if s.name == key and not s.is_unavailable)
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node

    def uv(self):
        return self.node('ShaderNodeTexCoord').outputs["UV"]

    def separate(self, socket):
        return self.node('ShaderNodeSeparateXYZ', {0: socket}).outputs

    def emit(self, socket):
        """The material: emission of the value at `socket`, brought to where light is positive."""
        shown = self.node('ShaderNodeVectorMath', {0: socket, 1: (0.2, 0.2, 0.2), 2: (0.5, 0.5, 0.5)},
                          operation='MULTIPLY_ADD').outputs[0]
        emission = self.node('ShaderNodeEmission', {"Color": shown})
        output = self.tree.nodes.new('ShaderNodeOutputMaterial')
        self.tree.links.new(emission.outputs[0], output.inputs["Surface"])
        return self.material


def both(scene, render):
    """This engine's picture and Cycles'."""
    scene.render.engine = 'LIGHT_MESHES'
    ours = render(scene)["Combined"][..., :3]
    scene.render.engine = 'CYCLES'
    return ours, render(scene)["Combined"][..., :3]


def agree(ours, theirs, median=0.005, most=0.03):
    """Whether the pictures are the same: in the median, and at the 99th percentile away from the edges of patterns."""
    difference = np.abs(ours - theirs).max(2) / np.maximum(np.abs(theirs).max(2), 0.05)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(theirs, ((1, 1), (1, 1), (0, 0)), 'edge'), (3, 3), (0, 1))
    smooth = np.ptp(around, axis=(3, 4)).max(2) < 0.15 * max(theirs.max(), 0.05)
    assert smooth.mean() > 0.3
    assert np.median(difference) <= median, np.median(difference)
    assert np.quantile(difference[smooth], 0.99) <= most, np.quantile(difference[smooth], 0.99)


def check(plane, scene, render, socket, tree, **bounds):
    plane.data.materials.clear()
    plane.data.materials.append(tree.emit(socket))
    ours, theirs = both(scene, render)
    assert theirs.max() > 0.01
    agree(ours, theirs, **bounds)
