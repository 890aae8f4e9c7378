"""Render each light of a .blend alone, with this engine and with Cycles; test_cycles.py runs it in a separate process.

python cycles_pictures.py FILE.blend FOLDER: writes FOLDER/NAME.ours.exr, NAME.cycles.exr and cases.json.
"""

import json
import os
import sys
from pathlib import Path

import bpy
import light_meshes_addon

# Name → the light's object, and what is changed about its data (values that this Blender lacks are left out).
CASES = {
    "point": ("Point", {}),
    "point, exposure": ("Point", {"exposure": 1.5}),
    "point, temperature": ("Point", {"use_temperature": True, "temperature": 3200.0}),
    "sun": ("Sun", {}),
    "sun, exposure": ("Sun", {"exposure": -1.0}),
    "sun, temperature": ("Sun", {"use_temperature": True, "temperature": 8000.0}),
    "spot": ("Spot", {}),
    "spot, hard": ("Spot", {"spot_blend": 0.0}),
    "spot, wide and blended": ("Spot", {"spot_size": 2.4, "spot_blend": 1.0}),
    "spot, exposure and temperature": ("Spot", {"exposure": 0.5, "use_temperature": True, "temperature": 2000.0}),
    "area": ("Area", {}),
    "area, disk": ("Area", {"shape": 'DISK'}),
    "area, rectangle": ("Area", {"shape": 'RECTANGLE', "size_y": 0.001}),
    "area, ellipse": ("Area", {"shape": 'ELLIPSE', "size_y": 0.001}),
    "area, narrow spread": ("Area", {"spread": 1.2}),
    "area, exposure and temperature": ("Area", {"exposure": 1.0, "use_temperature": True, "temperature": 4500.0}),
    "area, not normalized": ("Area", {"normalize": False, "energy": 3e7}),
}
# Name → colour of a Transparent BSDF on the plate and the column.
PANES = {"transparent, grey": (0.7, 0.7, 0.7, 1), "transparent, coloured": (0.9, 0.5, 0.3, 1)}
# Name → the camera's type, and its depth of field.
LENSES = {
    "round": ('PERSP', {"focus_distance": 2.5, "aperture_fstop": 1 / 36}),
    "round, focus behind": ('PERSP', {"focus_distance": 50.0, "aperture_fstop": 1 / 36}),
    "triangle": ('PERSP', {"focus_distance": 2.5, "aperture_fstop": 1 / 40, "aperture_blades": 3,
                           "aperture_rotation": 0.3}),
    "anamorphic": ('PERSP', {"focus_distance": 2.5, "aperture_fstop": 1 / 40, "aperture_blades": 6,
                             "aperture_rotation": 0.2, "aperture_ratio": 2.0}),
    "orthographic": ('ORTHO', {"focus_distance": 2.5, "aperture_fstop": 1 / 16}),
}


def transparent(material, color):
    tree = material.node_tree
    shader = tree.nodes.new('ShaderNodeBsdfTransparent')
    shader.inputs["Color"].default_value = color
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


def main(file, folder):
    done = {}
    for name, (light, changes) in CASES.items():
        bpy.ops.wm.open_mainfile(filepath=str(file))
        scene = bpy.context.scene
        data = bpy.data.objects[light].data
        if missing := [key for key in changes if not hasattr(data, key)]:
            done[name] = f"this Blender's lights have no {missing[0]}"
            continue
        for ob in scene.objects:
            ob.hide_render = ob.type == 'LIGHT' and ob.name != light
        for key, value in changes.items():
            setattr(data, key, value)
        prepare(scene)
        render(scene, folder, name)
        done[name] = ""
    for name, color in PANES.items():
        bpy.ops.wm.open_mainfile(filepath=str(file))
        scene = bpy.context.scene
        for ob in scene.objects:
            ob.hide_render = ob.type == 'LIGHT' and ob.name != "Point"
        for thing in ("Plate", "Column"):
            transparent(scene.objects[thing].data.materials[0], color)
        prepare(scene)
        scene.objects["Column"].location.z += 0.1  # its end must not coincide with the floor
        scene.cycles.transparent_max_bounces = scene.cycles.min_transparent_bounces = 32  # no roulette, so no noise
        render(scene, folder, name)
        done[name] = ""
    glowing_edge()
    scene = bpy.context.scene
    prepare(scene)
    scene.light_meshes.samples = scene.cycles.samples = 256
    same_filter(scene)
    render(scene, folder, "edge")
    for name, (kind, dof) in LENSES.items():
        glowing_dot(kind, dof)
        scene = bpy.context.scene
        prepare(scene)
        scene.light_meshes.samples, scene.cycles.samples = 1024, 4096
        same_filter(scene)
        render(scene, folder, f"lens, {name}")
    (folder / "cases.json").write_text(json.dumps(done))


def render(scene, folder, name):
    for engine, kind in (('LIGHT_MESHES', "ours"), ('CYCLES', "cycles")):
        scene.render.engine = engine
        scene.render.filepath = str(folder / f"{name}.{kind}.exr")
        bpy.ops.render.render(write_still=True)


def same_filter(scene):
    scene.render.filter_size = scene.cycles.filter_width = 1.5
    scene.cycles.pixel_filter_type = 'BLACKMAN_HARRIS'


def glowing_edge():
    """A glow that ends along x = y/32, seen from above; a pixel is 1 wide."""
    glow([(-1.25, -40, 0), (40, -40, 0), (40, 40, 0), (1.25, 40, 0)], 'ORTHO')


def glowing_dot(kind, dof):
    """A glow of 3×3 pixels, at a distance of 5; its circle of confusion has a radius of about 8 pixels."""
    size = 1.5 if kind == 'ORTHO' else 0.15
    x, y = (3.0, -2.0) if kind == 'ORTHO' else (0.3, -0.2)
    camera = glow([(x + i * size, y + j * size, 0) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))], kind)
    camera.dof.use_dof = True
    for name, value in dof.items():
        setattr(camera.dof, name, value)


def glow(corners, kind):
    """A scene with a glowing quadrilateral and a camera above it, which is returned."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("glow")
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("glow")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    glow = nodes.new('ShaderNodeEmission')
    material.node_tree.links.new(glow.outputs[0], nodes["Material Output"].inputs["Surface"])
    mesh.materials.append(material)
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = kind, 32
    scene = bpy.context.scene
    for data, z in ((mesh, 0), (camera, 5)):
        ob = bpy.data.objects.new(data.name, data)
        ob.location.z = z
        scene.collection.objects.link(ob)
    scene.camera = ob
    scene.render.resolution_x = scene.render.resolution_y = 32
    return camera


def prepare(scene):
    """Both engines: one ray through the middle of a pixel, direct light only, linear float EXR."""
    ours, cycles = scene.light_meshes, scene.cycles
    ours.shadows, ours.mode, ours.samples = 'SHARP', 'RAY_CASTING', 1
    cycles.device, cycles.samples, cycles.use_adaptive_sampling = 'CPU', 1, False
    cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = 'BLACKMAN_HARRIS', 0.01  # a box is a pixel wide all the same
    cycles.max_bounces = 0
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    scene.render.threads_mode, scene.render.threads = 'FIXED', 2
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'IMAGE'
    image.file_format, image.color_depth, image.color_mode = 'OPEN_EXR', '32', 'RGB'
    scene.render.use_file_extension = False


if __name__ == "__main__":
    light_meshes_addon.register()
    main(Path(sys.argv[1]), Path(sys.argv[2]))
    light_meshes_addon.unregister()
    sys.stdout.flush()
    os._exit(0)  # some bpy crash or hang at exit
