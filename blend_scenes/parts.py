"""Functions that the scene scripts share: a clean file, meshes, materials, lights, a camera, and saving."""

import shutil
import tempfile
import time
from itertools import pairwise
from math import cos, pi, sin
from pathlib import Path

import bpy
import light_meshes_addon
from mathutils import Vector

HERE = Path(__file__).parent


def clean_scene(width, height, **light_meshes):
    """Make an empty scene that renders with Light Meshes; `light_meshes` are its settings."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if not hasattr(bpy.types.Scene, "light_meshes"):
        light_meshes_addon.register()
    scene = bpy.context.scene
    scene.render.engine = 'LIGHT_MESHES'
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
    scene.light_meshes.glass_shadows = 'CLEAR'
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.view_settings.view_transform = 'Standard'
    for name, value in light_meshes.items():
        setattr(scene.light_meshes, name, value)
    return scene


def world(color, strength=1.0):
    made = bpy.data.worlds.new("World")
    made.use_nodes = True
    background = made.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*color, 1)
    background.inputs["Strength"].default_value = strength
    bpy.context.scene.world = made


def add(name, data, location=(0, 0, 0), rotation=(0, 0, 0), scale=(1, 1, 1)):
    made = bpy.data.objects.new(name, data)
    made.location, made.rotation_euler, made.scale = location, rotation, scale
    bpy.context.scene.collection.objects.link(made)
    return made


def mesh(name, vertices, faces, material=None, smooth=False):
    made = bpy.data.meshes.new(name)
    made.from_pydata(vertices, [], faces)
    made.polygons.foreach_set("use_smooth", [smooth] * len(made.polygons))
    if material:
        made.materials.append(material)
    made.validate()
    made.update()
    return made


def box(name, low, high, material=None):
    (x0, y0, z0), (x1, y1, z1) = low, high
    vertices = [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh(name, vertices, faces, material)


def lathe(name, profile, sides, material=None, smooth=True):
    """Turn the (radius, z) points of `profile` around z. Ends on the axis are closed.

    With smooth="sides", level rings such as the ends of a cylinder stay flat, with a sharp edge.
    """
    vertices, rings = [], []
    for radius, z in profile:
        if radius == 0:
            rings.append([len(vertices)] * sides)
            vertices.append((0, 0, z))
        else:
            rings.append(list(range(len(vertices), len(vertices) + sides)))
            vertices += [(radius * cos(2 * pi * k / sides), radius * sin(2 * pi * k / sides), z) for k in range(sides)]
    faces = []
    for low, high in pairwise(rings):
        for k in range(sides):
            corners = (low[k], low[(k + 1) % sides], high[(k + 1) % sides], high[k])
            faces.append(tuple(dict.fromkeys(corners)))
    made = mesh(name, vertices, faces, material, bool(smooth))
    if smooth == "sides":
        level = [abs(face.normal.z) > 0.999 for face in made.polygons]
        made.polygons.foreach_set("use_smooth", [not flat for flat in level])
        # The edges are also marked sharp, because Cycles would otherwise blend the normals across the rim.
        rims = {key for face, flat in zip(made.polygons, level, strict=True) if flat for key in face.edge_keys}
        made.edges.foreach_set("use_edge_sharp", [edge.key in rims for edge in made.edges])
        made.update()
    return made


def principled(name, color=(0.8, 0.8, 0.8), **inputs):
    """Make a Principled material. Keywords are its inputs, with _ in place of a space."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*color, 1)
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    return made


def diffuse(name, color):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes = made.node_tree.nodes
    nodes.remove(nodes["Principled BSDF"])
    shader = nodes.new('ShaderNodeBsdfDiffuse')
    shader.inputs["Color"].default_value = (*color, 1)
    made.node_tree.links.new(shader.outputs[0], nodes["Material Output"].inputs["Surface"])
    return made


def light(name, kind, energy, location=(0, 0, 0), target=None, color=(1, 1, 1), **values):
    """Make a light with shadow edges of one width, as in the paper. Spots, areas and suns look at `target`."""
    data = bpy.data.lights.new(name, kind)
    data.energy, data.color = energy, color
    for key, value in values.items():
        setattr(data, key, value)
    data.light_meshes.softness = 'SCENE'
    made = add(name, data, location)
    if target is not None:
        made.rotation_euler = towards(location, target)
    return made


def camera(location, target, angle):
    data = bpy.data.cameras.new("Camera")
    data.angle = angle
    bpy.context.scene.camera = add("Camera", data, location, towards(location, target))


def towards(location, target):
    """Return the Euler angles of an object that looks along its −z, with y up."""
    return (Vector(target) - Vector(location)).to_track_quat('-Z', 'Y').to_euler()


def by_both_engines(make, folder, samples):
    """Render the scene that `make` returns into FOLDER/ENGINE.png, by this engine and by Cycles with so many samples.

    Cycles has as many bounces of diffuse light as this engine, and no denoiser.
    """
    scene = make()
    scene.cycles.samples, scene.cycles.max_bounces, scene.cycles.use_denoising = (
        samples, scene.light_meshes.bounces, False)
    for engine in ('LIGHT_MESHES', 'CYCLES'):
        scene.render.engine = engine
        scene.render.filepath = str(Path(folder) / f"{engine}.png")
        began = time.perf_counter()
        bpy.ops.render.render(write_still=True)
        print(f"{engine}: {time.perf_counter() - began:.1f} s")


def save(name):
    """Write blend_scenes/NAME.blend without the paths of this machine, which a .blend stores in several places."""
    bpy.context.scene.render.filepath = "//"
    for screen in bpy.data.screens:
        for space in (space for area in screen.areas for space in area.spaces if space.type == 'FILE_BROWSER'):
            if space.params:
                space.params.directory = b"//"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)
        shutil.move(path, HERE / path.name)
    print(f"{name}.blend: {(HERE / path.name).stat().st_size / 1000:.0f} kB")
