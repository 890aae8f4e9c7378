"""What materials cost: python tests/support/materials_cost.py [materials], in a Python with bpy and the engine.

Prints how long the nodes of 5,000 materials take to translate (CPU seconds, the best of three), plain and with a
texture and a ramp; and how many times as long a picture takes with twenty procedural materials, and with twenty rough
metals, as with plain colours (CPU seconds, interleaved, the median of three). It is run by hand: times are no test.
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

import bpy
import light_meshes_addon
from light_meshes.picture.render import render_image
from light_meshes.scene.snapshot import read

TEXTURES = ("Noise", "Voronoi", "Wave", "Magic", "Brick", "Checker", "Gradient")
SIDE = 5  # balls along one side, four rows of them


def material(name, texture=None, **inputs):
    """Return a Principled BSDF; texture: what feeds its colour and roughness, by a ramp."""
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        made.use_nodes = True
    tree = made.node_tree
    principled = tree.nodes["Principled BSDF"]
    for key, value in inputs.items():
        principled.inputs[key.replace("_", " ")].default_value = value
    if texture:
        node, ramp = tree.nodes.new(f"ShaderNodeTex{texture}"), tree.nodes.new('ShaderNodeValToRGB')
        tree.links.new(node.outputs[0], ramp.inputs[0])
        tree.links.new(ramp.outputs[0], principled.inputs["Base Color"])
        tree.links.new(node.outputs[0], principled.inputs["Roughness"])
    return made


def translation(count, texture):
    """CPU seconds of the translation of `count` materials."""
    from light_meshes_addon.export.materials import Materials
    from light_meshes_addon.export.report import Report

    bpy.ops.wm.read_factory_settings(use_empty=True)
    made = [material(f"M{i}", texture, IOR=1.3 + i / count) for i in range(count)]
    depsgraph = bpy.context.evaluated_depsgraph_get()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(3):
            materials, began = Materials(Report(), Path(folder), depsgraph), time.process_time()
            for one in made:
                materials.index(one)
            found.append(time.process_time() - began)
    return min(found)


def balls(make):
    """Return the engine's scene of twenty balls on a floor, with the materials make(0), make(1), …"""
    from light_meshes_addon.render_engine import LightMeshesEngine

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = 'LIGHT_MESHES'
    for i in range(20):
        place = (i % SIDE - 2, i // SIDE - 1.5, 0)
        bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=0.45, location=place)
        bpy.context.object.data.materials.append(make(i))
    bpy.ops.mesh.primitive_plane_add(size=12, location=(0, 0, -0.45))
    bpy.context.object.data.materials.append(material("Floor", Specular_IOR_Level=0.0))
    for place in ((3, -3, 5), (-4, 1, 4), (0, 4, 6)):
        lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", 'POINT'))
        lamp.location, lamp.data.energy = place, 300.0
        scene.collection.objects.link(lamp)
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.location, scene.camera.rotation_euler = (0, -6, 6), (0.75, 0, 0)
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x, scene.render.resolution_y = 160, 120
    scene.light_meshes.shadows = 'SHARP'
    with tempfile.TemporaryDirectory() as folder:
        LightMeshesEngine.export_to = Path(folder) / "scene"
        try:
            bpy.ops.render.render()
        finally:
            LightMeshesEngine.export_to = None
        return read(Path(folder) / "scene")


def main(count):
    light_meshes_addon.register()
    for texture in (None, "Noise"):
        print(f"{count} materials, {texture or 'plain'}: {translation(count, texture):.2f} s", flush=True)
    kinds = {"plain": lambda i: material(f"Plain {i}", Base_Color=(0.2 + i / 30, 0.5, 0.4, 1)),
             "procedural": lambda i: material(f"Procedural {i}", TEXTURES[i % len(TEXTURES)]),
             "metals": lambda i: material(f"Metal {i}", Metallic=1.0, Roughness=0.2 + i / 30)}
    scenes = {name: balls(make) for name, make in kinds.items()}
    seconds = {name: [] for name in kinds}
    for _ in range(3):
        for name, scene in scenes.items():
            began = time.process_time()
            render_image(scene)
            seconds[name].append(time.process_time() - began)
            print(f"  {name}: {seconds[name][-1]:.2f} s", flush=True)
    plain = statistics.median(seconds["plain"])
    for name, times in seconds.items():
        print(f"{name}: {statistics.median(times) / plain:.2f} times the plain ones' {plain:.2f} s", flush=True)
    light_meshes_addon.unregister()
    from light_meshes_addon.headless import leave

    leave(0)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5000)
