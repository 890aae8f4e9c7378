"""Sheets of node trees by this bpy's Cycles and by Light Meshes: for a Python with another bpy, see
test_node_versions.py. Arguments: a folder, and which sheets. Of each it writes NAME.ours.exr and NAME.theirs.exr, and
for a sheet of the catalogue NAME.json, with the names of its cells.
"""

import json
import sys
from pathlib import Path

import bpy
import light_meshes_addon
import node_catalogue
import node_groups
import node_sources
from node_trees import Tree, World, exact, lamp_sheet, outputs_of_lamps, sheet

CELL = 20  # pixels of a case of the catalogue
LAMP_CELL = 24  # pixels of an area lamp's cell, to which Cycles needs many samples
PARTS = 4  # sheets of the values: to make a tree takes Blender longer, the more of them there are


def bumps():
    """Bumps by a noise, and displacement as Layer Weight sees it."""
    for kind in ("Generated", "UV", "Object"):
        tree = Tree()
        place = tree.node('ShaderNodeTexCoord').outputs[kind]
        noise = tree.node('ShaderNodeTexNoise', {"Vector": place, "Scale": 1.5, "Detail": 1.0}).outputs[0]
        yield tree, tree.node('ShaderNodeBump', {"Height": noise, "Distance": 0.4}).outputs[0]
    tree = Tree()
    noise = tree.node('ShaderNodeTexNoise', {"Vector": tree.uv(), "Scale": 1.5, "Detail": 1.0}).outputs[0]
    output = tree.tree.nodes.new('ShaderNodeOutputMaterial')
    tree.tree.links.new(tree.node('ShaderNodeDisplacement', {"Height": noise, "Scale": 0.4}).outputs[0],
                        output.inputs["Displacement"])
    tree.material.displacement_method = 'BUMP'
    yield tree, tree.node('ShaderNodeLayerWeight').outputs["Facing"]


def others():
    """What releases may have changed: random numbers of objects, attributes, tangents, checkers, bricks."""
    for name in ("Random", "Location"):
        tree = Tree()
        yield tree, tree.node('ShaderNodeObjectInfo').outputs[name]
    tree = Tree()
    yield tree, tree.node('ShaderNodeTangent', direction_type='UV_MAP').outputs[0]
    tree = Tree()
    yield tree, tree.node('ShaderNodeTexChecker', {"Vector": tree.uv(), "Scale": 4.0}).outputs[0]
    tree = Tree()
    yield tree, tree.node('ShaderNodeNormalMap', {"Color": tree.uv()}).outputs[0]
    for output in ("View Vector", "View Z Depth", "View Distance"):
        tree = Tree()
        yield tree, tree.node('ShaderNodeCameraData').outputs[output]
    for output in ("Pointiness", "Random Per Island"):
        tree = Tree()
        yield tree, tree.node('ShaderNodeNewGeometry').outputs[output]
    for kind in ('POINT', 'VECTOR', 'NORMAL'):
        tree = Tree()
        place = tree.node('ShaderNodeNewGeometry').outputs["Position"]
        for a, b in (('WORLD', 'OBJECT'), ('OBJECT', 'CAMERA')):
            place = tree.node('ShaderNodeVectorTransform', {0: place}, vector_type=kind, convert_from=a,
                              convert_to=b).outputs[0]
        yield tree, tree.node('ShaderNodeVectorMath', {0: place, "Scale": 0.2}, operation='SCALE').outputs[0]


def worlds(scene):
    """A world of all that releases may have changed: an image, turned and mixed with a sky, by kind of ray."""
    tree = World(scene)
    image = bpy.data.images.new("sky", 32, 16, float_buffer=True)
    image.pixels.foreach_set([1.0 if i % 4 == 3 else 0.2 + 0.6 * (i % 128) / 128 for i in range(32 * 16 * 4)])
    image.pack()
    place = tree.node('ShaderNodeTexCoord').outputs["Generated"]
    turned = tree.node('ShaderNodeMapping', {"Vector": place, "Rotation": (0.2, 0.4, 1.1)}).outputs[0]
    around = tree.node('ShaderNodeTexEnvironment', {0: turned}, image=image).outputs[0]
    for one in (tree.node('ShaderNodeAttribute').outputs["Alpha"], tree.node('ShaderNodeAttribute', attribute_name=(
            "frame_current"), attribute_type='VIEW_LAYER').outputs["Vector"]):  # 1 each
        around = tree.node('ShaderNodeVectorMath', {0: around, 1: one}, operation='MULTIPLY').outputs[0]
    sky = tree.node('ShaderNodeTexSky')  # of the release's first kind
    sky.sun_disc, sky.altitude = False, 100.0
    path = tree.node('ShaderNodeLightPath').outputs["Is Camera Ray"]
    both = tree.node('ShaderNodeAddShader', {0: tree.background(around), 1: tree.background(sky.outputs[0], 0.1)})
    tree.shine(tree.node('ShaderNodeMixShader', {0: path, 1: tree.background((1, 0, 0, 1)), 2: both.outputs[0]}
                         ).outputs[0])
    exact(scene)
    scene.world.cycles.sampling_method = 'NONE'  # Cycles needs no map of where it shines most: nothing is lit
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.camera.data.angle, scene.camera.rotation_euler = 1.2, (2.2, 0.0, 0.4)


SHEETS = {"bumps": bumps, "others": others}
CATALOGUE = node_catalogue.SHEETS | node_groups.SHEETS | node_sources.SHEETS
_values = CATALOGUE.pop("values")
CATALOGUE |= {f"values {n}": lambda n=n: _values()[n::PARTS] for n in range(PARTS)}


def draw(folder, name):
    """Draw one sheet, in a scene of its own."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.view_settings.view_transform = 'Standard'
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.location = (0, 0, 10)
    scene.collection.objects.link(scene.camera)
    if name == "worlds":
        worlds(scene)
    elif name == "lamps":
        lamp_sheet(scene, outputs_of_lamps(['POINT', 'SPOT']))
    elif name == "suns":  # apart, as Cycles links no more than 64 lamps to things of their own
        lamp_sheet(scene, outputs_of_lamps(['SUN']))
    elif name == "area lamps":
        lamp_sheet(scene, outputs_of_lamps(['AREA']), LAMP_CELL)
        scene.cycles.samples = 16
    elif name in CATALOGUE:
        cases = CATALOGUE[name]()
        columns = node_catalogue.sheet(scene, cases, CELL)
        if name.startswith("values"):  # 900 cells, and nothing in them is by chance
            scene.cycles.samples = 1
        (folder / f"{name}.json").write_text(json.dumps([CELL, columns, [label for label, _ in cases]]))
    else:
        sheet(scene, list(SHEETS[name]()))
    for engine, whose in (('LIGHT_MESHES', "ours"), ('CYCLES', "theirs")):
        scene.render.engine = engine
        scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
        scene.render.image_settings.file_format = 'OPEN_EXR'
        scene.render.image_settings.color_depth = '32'
        scene.render.filepath = str(folder / f"{name}.{whose}.exr")
        bpy.ops.render.render(write_still=True)


def main(folder, *names):
    light_meshes_addon.register()
    for name in names:
        print("SHEET", name, flush=True)
        draw(Path(folder), name)
    from light_meshes_addon.headless import leave
    light_meshes_addon.unregister()
    leave(0)


main(*sys.argv[1:])
