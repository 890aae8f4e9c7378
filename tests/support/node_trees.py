"""Node trees written quickly, and sheets of planes that show many of them in one picture; any bpy runs this."""

import math

import bpy


class Tree:
    """A material's node tree, written down quickly."""

    _place = None

    def __init__(self, name="Material"):
        self.material = bpy.data.materials.new(name)
        if bpy.app.version < (5, 0):
            self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()

    def node(self, idname, inputs=None, **properties):
        """Return a node; inputs by name or position: values, or sockets that are linked."""
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

    def place(self):
        """Return the sockets of the two UV coordinates: of one node, however often they are asked for, since Blender
        takes long for each node.
        """
        self._place = self._place or tuple(self.separate(self.uv())[:2])
        return self._place

    def separate(self, socket):
        return self.node('ShaderNodeSeparateXYZ', {0: socket}).outputs

    def emit(self, socket):
        """Return the material: emission of the value at `socket`, brought to where light is positive."""
        shown = self.node('ShaderNodeVectorMath', {0: socket, 1: (0.2, 0.2, 0.2), 2: (0.5, 0.5, 0.5)},
                          operation='MULTIPLY_ADD').outputs[0]
        emission = self.node('ShaderNodeEmission', {"Color": shown})
        output = next((n for n in self.tree.nodes if n.bl_idname == 'ShaderNodeOutputMaterial'), None)
        output = output or self.tree.nodes.new('ShaderNodeOutputMaterial')
        self.tree.links.new(emission.outputs[0], output.inputs["Surface"])
        return self.material


class LampTree(Tree):
    """The node tree of a lamp (its data)."""

    def __init__(self, lamp):
        lamp.use_nodes = True
        self.tree = lamp.node_tree
        self.tree.nodes.clear()

    def emit(self, color=(1, 1, 1, 1), strength=1.0):
        """The lamp shines by an Emission of these values or sockets, which is returned."""
        emission = self.node('ShaderNodeEmission', {"Color": color, "Strength": strength})
        self.shine(emission.outputs[0])
        return emission

    def shine(self, socket):
        """The lamp shines by the shader at `socket`."""
        self.tree.links.new(socket, self.tree.nodes.new('ShaderNodeOutputLight').inputs[0])


class World(Tree):
    """A world's node tree; the scene has it."""

    def __init__(self, scene):
        scene.world = bpy.data.worlds.new("World")
        if bpy.app.version < (5, 0):
            scene.world.use_nodes = True
        self.tree = scene.world.node_tree
        self.tree.nodes.clear()
        self.output = self.tree.nodes.new('ShaderNodeOutputWorld')

    def background(self, color, strength=1.0):
        """Return the output of a Background of this colour."""
        return self.node('ShaderNodeBackground', {"Color": color, "Strength": strength}).outputs[0]

    def shine(self, shader):
        """The world is what `shader`, the output of one, gives."""
        self.tree.links.new(shader, self.output.inputs["Surface"])


def space(tree):
    """Places in space that move over the plane, with all three numbers."""
    return tree.node('ShaderNodeMapping', {"Vector": tree.uv(), "Location": (-0.4, -0.3, 0.2),
                                           "Rotation": (0.5, 0.3, 0.2)}).outputs[0]


def sheet(scene, sockets, cell=32):
    """Show these sockets (tree, socket) side by side, each on a plane of `cell` pixels a side; how many columns."""
    columns = math.ceil(math.sqrt(len(sockets)))
    for i, (tree, socket) in enumerate(sockets):
        mesh = bpy.data.meshes.new("Plane")
        corners = [(x, y, 0.2 * x + 0.1 * y) for x, y in ((-.5, -.5), (.5, -.5), (.5, .5), (-.5, .5))]
        mesh.from_pydata(corners, [], [(0, 1, 2, 3)])  # tilted: on a level one many vectors have no direction
        for corner, at in zip(mesh.uv_layers.new(name="UVMap").uv, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
            corner.vector = at
        mesh.materials.append(tree.emit(socket))
        ob = bpy.data.objects.new(f"Plane {i}", mesh)
        ob.location = (i % columns + 0.5 - columns / 2, columns / 2 - i // columns - 0.5, 0)
        ob.color, ob.pass_index = (0.3, 0.6, 0.9, 0.4), 2
        scene.collection.objects.link(ob)
    camera = scene.camera.data
    camera.type, camera.ortho_scale = 'ORTHO', columns
    exact(scene)
    scene.render.resolution_x = scene.render.resolution_y = columns * cell
    return columns


def lamp_sheet(scene, cases, cell=32):
    """Show lamps side by side, each on a matt plane that it alone lights.

    cases: [(type, tree → colour or vector, rotation)]. Returns the cells of the picture (rows from above), in order.
    """
    columns = math.ceil(math.sqrt(len(cases)))
    matt = Tree("Matt")
    matt.tree.links.new(matt.node('ShaderNodeBsdfDiffuse').outputs[0],
                        matt.tree.nodes.new('ShaderNodeOutputMaterial').inputs[0])
    for i, (kind, socket, rotation) in enumerate(cases):
        x, y = i % columns + 0.5 - columns / 2, columns / 2 - i // columns - 0.5
        mesh = bpy.data.meshes.new("Plane")
        mesh.from_pydata([(-.5, -.5, 0), (.5, -.5, 0), (.5, .5, 0), (-.5, .5, 0)], [], [(0, 1, 2, 3)])
        mesh.materials.append(matt.material)
        lamp = bpy.data.lights.new(f"Lamp {i}", kind)
        lamp.light_meshes.softness, lamp.energy = 'SIZE', 2.0 if kind == 'SUN' else 10.0
        if kind in ('POINT', 'SPOT'):
            lamp.shadow_soft_size = 0.0
        elif kind == 'SUN':
            lamp.angle = 0.0
        else:
            lamp.size = 0.02
        plane, ob = bpy.data.objects.new(f"Plane {i}", mesh), bpy.data.objects.new(f"Lamp {i}", lamp)
        plane.location, ob.location = (x, y, 0), (x + 0.1, y - 0.05, 0.7)
        ob.rotation_euler, ob.scale = rotation, (1.2, 0.8, 1.0)
        alone = bpy.data.collections.new(f"Of lamp {i}")
        alone.objects.link(plane)
        ob.light_linking.receiver_collection = alone
        for one in (plane, ob):
            scene.collection.objects.link(one)
        tree = LampTree(lamp)
        tree.emit(tree.node('ShaderNodeVectorMath', {0: socket(tree), 1: (0.1, 0.1, 0.1), 2: (0.5, 0.5, 0.5)},
                            operation='MULTIPLY_ADD').outputs[0])
    camera = scene.camera.data
    camera.type, camera.ortho_scale = 'ORTHO', columns
    exact(scene)
    scene.cycles.max_bounces, scene.light_meshes.shadows = 0, 'SHARP'
    scene.render.resolution_x = scene.render.resolution_y = columns * cell
    corners = [(i // columns * cell, i % columns * cell) for i in range(len(cases))]
    return [(slice(y, y + cell), slice(x, x + cell)) for y, x in corners]


def outputs_of_lamps(kinds):
    """Cases for `lamp_sheet`: all that nodes ask of lamps, of these types."""
    asked = {'ShaderNodeNewGeometry': ("Position", "Normal", "True Normal", "Incoming", "Parametric", "Backfacing"),
             'ShaderNodeTexCoord': ("Generated", "Normal", "UV", "Object", "Camera", "Window", "Reflection"),
             'ShaderNodeLightPath': ("Ray Depth",),
             'ShaderNodeObjectInfo': ("Location", "Color", "Alpha", "Object Index", "Random"),
             'ShaderNodeLightFalloff': ("Quadratic", "Linear", "Constant"),
             'ShaderNodeAttribute': ("Fac", "Alpha", "Color"),
             'ShaderNodeCameraData': ("View Vector", "View Z Depth", "View Distance"), 'ShaderNodeTangent': (0,),
             'ShaderNodeNormalMap': (0,), 'ShaderNodeTexWave': (1,)}
    given = {('ShaderNodeAttribute', "Fac"): {"attribute_type": 'OBJECT', "attribute_name": "energy"},
             ('ShaderNodeAttribute', "Alpha"): {"attribute_name": "nothing"},
             ('ShaderNodeAttribute', "Color"): {"attribute_type": 'VIEW_LAYER', "attribute_name": "frame_current"},
             ('ShaderNodeNormalMap', 0): {"space": 'OBJECT'}}
    inputs = {"Linear": {"Strength": 3.0, "Smooth": 0.2}, 0: {"Color": (0.9, 0.3, 0.6, 1.0)}}

    def output(idname, name):
        return lambda tree: tree.node(idname, inputs.get(name, {}) if idname != 'ShaderNodeTangent' else {},
                                      **given.get((idname, name), {})).outputs[name]
    return [(kind, output(idname, name), (0.2, 0.1, 0.4)) for kind in kinds for idname, names in asked.items()
            for name in names]


def exact(scene):
    """Both engines look at pixels' middles, once."""
    scene.render.resolution_percentage, scene.render.filter_size, scene.light_meshes.samples = 100, 0.0, 1
    cycles = scene.cycles
    cycles.samples, cycles.filter_width, cycles.use_denoising, cycles.use_adaptive_sampling = 4, 0.01, False, False
