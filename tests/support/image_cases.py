"""Render squares of one colour with this engine and with Cycles; test_addon_images.py runs it in a Blender of any
version.

python image_cases.py FOLDER [WORKING_SPACE…]: writes FOLDER/cases.json: working space → engine → colour of each case.
"""

import itertools
import json
import math
import os
import sys
from pathlib import Path

import bpy
import numpy as np
from exr import write_floats

FILES = {"png": ('PNG', False), "exr": ('OPEN_EXR', True), "tif": ('TIFF', True)}
MODES = ('STRAIGHT', 'PREMUL', 'CHANNEL_PACKED', 'NONE')
SPACES = ("sRGB", "Non-Color", "Linear Rec.709", "ACEScg", "Linear CIE-XYZ D65")
CONVERTED = ("Rec.1886", "Filmic sRGB", "Display P3", "Linear DCI-P3 D65")  # by OpenColorIO
COLOR = (0.8, 0.4, 0.1, 0.5)
# Kind of file or image, alpha mode, whether Alpha is linked, colour space, and where the pixels are stored.
CASES = [
    *itertools.product(FILES, MODES, (False, True), SPACES[:3], ("file",)),
    *itertools.product(FILES, MODES[:1], (False, True), SPACES[3:] + CONVERTED, ("file",)),
    *itertools.product(("png",), MODES[:1], (False, True), SPACES + CONVERTED, ("packed",)),
    *itertools.product(("exr",), MODES[1:2], (False, True), SPACES[1:4], ("packed",)),
    *itertools.product(("bytes", "floats"), MODES[:2], (False, True), SPACES[:4], ("generated",)),
]
WIDTH = 16


def main(folder, spaces):
    found = {}
    for space in spaces or [""]:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        if space:
            bpy.ops.wm.set_working_color_space(working_space=space, convert_colors=False)
        scene = build(folder)
        found[space] = {engine: colors(scene, engine, folder) for engine in ('LIGHT_MESHES', 'CYCLES')}
    (folder / "cases.json").write_text(json.dumps(found))


def saved(folder, kind):
    file_format, is_float = FILES[kind]
    image = bpy.data.images.new("file", 4, 4, alpha=True, float_buffer=is_float)
    image.pixels.foreach_set(np.tile(np.array(COLOR, np.float32), 16))
    image.filepath_raw, image.file_format = str(folder / f"color.{kind}"), file_format
    image.save()
    bpy.data.images.remove(image)
    return folder / f"color.{kind}"


def build(folder):
    scene = bpy.context.scene
    files = {kind: saved(folder, kind) for kind in FILES}
    for i, (kind, mode, linked, space, source) in enumerate(CASES):
        if source == "generated":
            image = bpy.data.images.new(f"image {i}", 4, 4, alpha=True, float_buffer=kind == "floats")
            image.generated_color = COLOR
        else:
            image = bpy.data.images.load(str(files[kind]))
        image.colorspace_settings.name = space
        image.alpha_mode = mode
        if source == "packed":
            image.pack()
        x, y = i % WIDTH, i // WIDTH
        mesh = bpy.data.meshes.new("square")
        mesh.from_pydata([(x, y, 0), (x + 1, y, 0), (x + 1, y + 1, 0), (x, y + 1, 0)], [], [(0, 1, 2, 3)])
        mesh.uv_layers.new(name="UV").data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1])
        mesh.materials.append(textured(image, linked))
        add(scene, mesh)
    height = (len(CASES) - 1) // WIDTH + 1
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = 'ORTHO', max(WIDTH, height)
    scene.camera = add(scene, camera, (WIDTH / 2, height / 2, 10))
    sun = bpy.data.lights.new("sun", 'SUN')
    sun.energy, sun.angle, sun.color = math.pi, 0, (0.5, 0.9, 0.7)
    if hasattr(sun, "use_temperature"):
        sun.use_temperature, sun.temperature = True, 4000
    add(scene, sun)
    scene.render.resolution_x, scene.render.resolution_y = 3 * WIDTH, 3 * height
    scene.render.film_transparent = True
    scene.light_meshes.shadows, scene.light_meshes.samples = 'SHARP', 1
    cycles = scene.cycles
    cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling, cycles.max_bounces = 32, False, False, 0
    cycles.pixel_filter_type, cycles.filter_width = 'BOX', 0.01
    return scene


def add(scene, data, location=(0, 0, 5)):
    ob = bpy.data.objects.new(data.name, data)
    ob.location = location if not isinstance(data, bpy.types.Mesh) else (0, 0, 0)
    scene.collection.objects.link(ob)
    return ob


def textured(image, linked):
    """Return a diffuse material with the image's colour; if Alpha is linked, it is cut out by the image's alpha."""
    material = bpy.data.materials.new(image.name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    texture, diffuse, clear, mix, output = (tree.nodes.new(f"ShaderNode{name}") for name in (
        "TexImage", "BsdfDiffuse", "BsdfTransparent", "MixShader", "OutputMaterial"))
    texture.image = image
    tree.links.new(texture.outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], mix.inputs[2])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    mix.inputs[0].default_value = 1
    if linked:
        tree.links.new(texture.outputs["Alpha"], mix.inputs[0])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return material


def colors(scene, engine, folder):
    """Return the RGBA of each case."""
    scene.render.engine = engine
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
    write_floats(scene, folder / f"{engine}.exr", 'RGBA')
    scene.render.use_file_extension = False
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    picture.colorspace_settings.name = "Non-Color"  # as it is in the file
    width, height = picture.size
    pixels = np.array(picture.pixels[:]).reshape(height, width, 4)
    bpy.data.images.remove(picture)
    return [pixels[3 * (i // WIDTH) + 1, 3 * (i % WIDTH) + 1].tolist() for i in range(len(CASES))]


if __name__ == "__main__":
    import light_meshes_addon

    light_meshes_addon.register()
    main(Path(sys.argv[1]), sys.argv[2:])
    light_meshes_addon.unregister()
    sys.stdout.flush()
    os._exit(0)  # some bpy crash or hang at exit
