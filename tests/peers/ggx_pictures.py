"""Sheets of balls and tilted squares of shiny materials, by this bpy's Cycles and by Light Meshes.

For any Python with a bpy, see test_ggx.py. python ggx_pictures.py FOLDER SHEET:LAMP.PART,LAMP.PART… …, where the sheet
is lobes, mixes or bumps, and the part is diffuse, gloss, or whole: writes SHEET/LAMP.PART.ours.npy and
SHEET/LAMP.PART.theirs.npy (rows from the bottom, RGB), and SHEET/cells.json, the materials' names in the order of the
cells.
"""

import json
import sys
from pathlib import Path

import bpy
import light_meshes_addon
import numpy as np
from mathutils import Vector

COLUMNS = 12  # cells in a row; each material has two cells, side by side
CELLS = {"lobes": 28, "mixes": 20, "bumps": 40}  # pixels of a side; bumps are steep, mixes take many samples
LAMPS = {
    "point": ('POINT', {"energy": 4000.0, "shadow_soft_size": 0.0}, (3, 2, 7)),
    "sun": ('SUN', {"energy": 3.0, "angle": 0.0}, (-3, 4, 6)),
    "spot": ('SPOT', {"energy": 9000.0, "shadow_soft_size": 0.0, "spot_size": 2.2, "spot_blend": 0.4}, (-4, -3, 8)),
    "area": ('AREA', {"energy": 3000.0, "size": 0.05}, (2, -4, 7)),
}
GOLD, TINT = (0.9, 0.6, 0.2, 1), (1.0, 0.7, 0.4, 1)


def principled(**inputs):
    return 'ShaderNodeBsdfPrincipled', inputs, {}


def cases():
    """Name → shader node, its inputs, its properties."""
    found = {}
    for roughness in (0.1, 0.2, 0.35, 0.5, 0.75, 1.0):
        found[f"plastic {roughness}"] = principled(Base_Color=(0.2, 0.5, 0.8, 1), Roughness=roughness)
        found[f"metal {roughness}"] = principled(Base_Color=GOLD, Metallic=1.0, Roughness=roughness)
    for ior in (0.7, 1.1, 2.0, 3.5):
        found[f"ior {ior}"] = principled(Base_Color=(0.5, 0.5, 0.5, 1), IOR=ior, Roughness=0.4)
    for level in (0.0, 0.2, 1.0):
        found[f"level {level}"] = principled(Base_Color=GOLD, Specular_IOR_Level=level, Roughness=0.6)
    found["tint"] = principled(Base_Color=(0.1, 0.4, 0.6, 1), Specular_Tint=TINT, Roughness=0.5, IOR=1.8)
    found["metal tint"] = principled(Base_Color=GOLD, Metallic=1.0, Specular_Tint=(0.3, 0.5, 0.9, 1), Roughness=0.5)
    found["half metal"] = principled(Base_Color=GOLD, Metallic=0.5, Roughness=0.45, Specular_Tint=TINT)
    for metallic in (0.0, 1.0):
        kind, inputs, _ = principled(Base_Color=GOLD, Metallic=metallic, Roughness=0.9)
        found[f"one bounce {metallic}"] = kind, inputs, {"distribution": 'GGX'}
    glossy = 'ShaderNodeBsdfAnisotropic'
    for roughness, distribution in ((0.15, 'MULTI_GGX'), (0.6, 'MULTI_GGX'), (1.0, 'MULTI_GGX'), (0.8, 'GGX')):
        found[f"glossy {roughness} {distribution}"] = glossy, {"Color": GOLD, "Roughness": roughness}, {
            "distribution": distribution}
    if hasattr(bpy.types, "ShaderNodeBsdfMetallic"):
        metallic = 'ShaderNodeBsdfMetallic'
        found["edge tint"] = metallic, {"Base_Color": GOLD, "Edge_Tint": TINT, "Roughness": 0.5}, {
            "fresnel_type": 'F82'}
        if "PHYSICAL_CONDUCTOR" in bpy.types.ShaderNodeBsdfMetallic.bl_rna.properties["fresnel_type"].enum_items:
            found["copper"] = metallic, {"IOR": (0.27, 0.68, 1.3), "Extinction": (3.6, 2.6, 2.3), "Roughness": 0.5}, {
                "fresnel_type": 'PHYSICAL_CONDUCTOR'}
    coat = {"Base_Color": (0.6, 0.1, 0.1, 1), "Roughness": 0.5, "Coat_Weight": 1.0}
    found["coat"] = principled(Coat_Roughness=0.2, **coat)
    found["rough coat"] = principled(Coat_Roughness=0.7, Coat_IOR=2.0, **coat)
    coat |= {"Coat_Weight": 0.6, "Coat_Tint": TINT}
    found["tinted coat"] = principled(Coat_Roughness=0.15, Metallic=0.5, **coat)
    cloth = {"Base_Color": (0.1, 0.3, 0.2, 1), "Roughness": 0.6, "Sheen_Weight": 1.0}
    found["sheen .2"] = principled(Sheen_Roughness=0.2, **cloth)
    found["sheen .5"] = principled(Sheen_Roughness=0.5, **cloth)
    found["sheen 1"] = principled(Sheen_Roughness=1.0, Sheen_Tint=TINT, **cloth)
    found["half a sheen over a coat"] = principled(**cloth | coat | {"Sheen_Weight": 0.5, "Coat_Roughness": 0.3})
    for roughness in (0.3, 0.7):
        found[f"fibres {roughness}"] = 'ShaderNodeBsdfSheen', {"Color": TINT, "Roughness": roughness}, {}
    found["diffuse"] = 'ShaderNodeBsdfDiffuse', {"Color": GOLD}, {}
    for roughness in (0.3, 1.0):
        found[f"rough diffuse {roughness}"] = 'ShaderNodeBsdfDiffuse', {"Color": GOLD, "Roughness": roughness}, {}
    return found


def shader(tree, kind, inputs, properties=()):
    """The output of a new shader node."""
    node = tree.nodes.new(kind)
    for key, value in dict(properties).items():
        setattr(node, key, value)
    for key, value in inputs.items():
        node.inputs[key.replace("_", " ")].default_value = value
    return node.outputs[0]


def mixed(tree, factor, first, second):
    """A Mix Shader of two: each (kind, inputs, properties), or an output; factor: a number, or a socket."""
    node = tree.nodes.new('ShaderNodeMixShader')
    if isinstance(factor, float):
        node.inputs[0].default_value = factor
    else:
        tree.links.new(factor, node.inputs[0])
    for side, socket in ((first, node.inputs[1]), (second, node.inputs[2])):
        tree.links.new(shader(tree, *side) if isinstance(side, tuple) else side, socket)
    return node.outputs[0]


def added(tree, first, second):
    node = tree.nodes.new('ShaderNodeAddShader')
    for side, socket in zip((first, second), node.inputs, strict=True):
        tree.links.new(shader(tree, *side), socket)
    return node.outputs[0]


def checks(tree, scale=6.0):
    """The factor of a checker by the place in the mesh."""
    place, node = tree.nodes.new('ShaderNodeTexCoord'), tree.nodes.new('ShaderNodeTexChecker')
    node.inputs["Scale"].default_value = scale
    tree.links.new(place.outputs["Generated"], node.inputs["Vector"])
    return node.outputs["Fac" if "Fac" in node.outputs else "Factor"]


def gradual(tree):
    """A factor that goes from 0 to 1 over the mesh."""
    place, node = tree.nodes.new('ShaderNodeTexCoord'), tree.nodes.new('ShaderNodeTexGradient')
    tree.links.new(place.outputs["Generated"], node.inputs["Vector"])
    return node.outputs["Fac" if "Fac" in node.outputs else "Factor"]


def mixes():
    """Name → function of a tree that makes the shader and returns its output."""
    glossy, diffuse = 'ShaderNodeBsdfAnisotropic', 'ShaderNodeBsdfDiffuse'
    sharp, soft = (glossy, {"Color": GOLD, "Roughness": 0.2}), (glossy, {"Color": TINT, "Roughness": 0.7})
    matt, blue = (diffuse, {"Color": GOLD}), (diffuse, {"Color": (0.1, 0.2, 0.8, 1), "Roughness": 0.8})
    plastic = principled(Base_Color=(0.2, 0.5, 0.8, 1), Roughness=0.3)
    rubber = principled(Base_Color=(0.6, 0.2, 0.1, 1), Roughness=0.8, IOR=1.8)
    metal = principled(Base_Color=GOLD, Metallic=1.0, Roughness=0.4)
    coated = principled(Base_Color=(0.6, 0.1, 0.1, 1), Roughness=0.6, Coat_Weight=1.0, Coat_Roughness=0.2)
    cloth = principled(Base_Color=(0.1, 0.3, 0.1, 1), Roughness=0.7, Sheen_Weight=1.0, Sheen_Roughness=0.4)
    frosted = ('ShaderNodeBsdfGlass', {"Color": (0.9, 0.95, 1, 1), "Roughness": 0.3, "IOR": 1.45})
    glow, clear = ('ShaderNodeEmission', {"Color": TINT, "Strength": 0.3}), ('ShaderNodeBsdfTransparent', {})
    pairs = {"diffuse, glossy": (matt, sharp), "two glossy": (sharp, soft), "two diffuse": (matt, blue),
             "plastic, rubber": (plastic, rubber), "plastic, diffuse": (plastic, matt),
             "plastic, metal": (plastic, metal), "plastic, transparent": (plastic, clear),
             "plastic, emission": (plastic, glow), "coat, diffuse": (coated, matt),
             "coat, plastic": (coated, plastic), "cloth, glossy": (cloth, sharp),
             "glass, glossy": (frosted, soft), "glass, plastic": (frosted, plastic),
             "sheen, diffuse": (('ShaderNodeBsdfSheen', {"Roughness": 0.6, "Color": TINT}), matt)}
    found = {}
    for name, (first, second) in pairs.items():
        found[f"{name}: .35"] = lambda tree, a=first, b=second: mixed(tree, 0.35, a, b)
        found[f"{name}: checks"] = lambda tree, a=first, b=second: mixed(tree, checks(tree), a, b)
        found[f"{name}: gradual"] = lambda tree, a=first, b=second: mixed(tree, gradual(tree), a, b)
    for name in ("two glossy", "coat, diffuse", "plastic, emission", "sheen, diffuse"):
        found[f"{name}: added"] = lambda tree, pair=pairs[name]: added(tree, *pair)
    found["four"] = lambda tree: mixed(tree, gradual(tree), mixed(tree, 0.5, sharp, soft),
                                       mixed(tree, checks(tree), plastic, coated))
    lamp = {"Base_Color": (0, 0, 0, 1), "Emission_Color": TINT, "Emission_Strength": 1.0, "Specular_IOR_Level": 0.0}
    for above in ({"Coat_Weight": 1.0, "Coat_Tint": GOLD, "Coat_Roughness": 0.9},
                  {"Sheen_Weight": 1.0, "Sheen_Roughness": 0.8}):
        found[f"{min(above)} over a glow"] = lambda tree, inputs=lamp | above: shader(tree, *principled(**inputs))
    found["half there"] = lambda tree: mixed(tree, 0.4, mixed(tree, checks(tree), clear, plastic), rubber)
    return found


def bumps():
    """Name → function of a tree that makes a shader on waves; see `mixes`."""
    def waves(tree, strength, kind, inputs, sockets=("Normal",)):
        place, wave = tree.nodes.new('ShaderNodeTexCoord'), tree.nodes.new('ShaderNodeTexWave')
        wave.inputs["Scale"].default_value = 1.5
        tree.links.new(place.outputs["Object"], wave.inputs["Vector"])
        bump = tree.nodes.new('ShaderNodeBump')
        bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = strength, 0.1
        tree.links.new(wave.outputs[0], bump.inputs["Height"])
        made = shader(tree, kind, inputs)
        for name in sockets:
            tree.links.new(bump.outputs[0], made.node.inputs[name])
        return made

    found = {}
    for name, (kind, inputs) in {
            "diffuse": ('ShaderNodeBsdfDiffuse', {"Color": GOLD}),
            "rough diffuse": ('ShaderNodeBsdfDiffuse', {"Color": GOLD, "Roughness": 1.0}),
            "sheen": ('ShaderNodeBsdfSheen', {"Color": GOLD, "Roughness": 0.7}),
            "metal": ('ShaderNodeBsdfAnisotropic', {"Color": GOLD, "Roughness": 0.5}),
            "plastic": principled(Base_Color=GOLD, Roughness=0.4)[:2],
            "coat": principled(Base_Color=GOLD, Roughness=0.4, Coat_Weight=1.0, Coat_Roughness=0.2)[:2]}.items():
        for strength in (0.3, 1.0):
            found[f"{name} {strength}"] = lambda tree, s=strength, k=kind, i=inputs: waves(tree, s, k, i)
    red = {"Base_Color": GOLD, "Roughness": 0.4, "Coat_Weight": 0.8, "Coat_Roughness": 0.2, "Coat_Tint": TINT}
    glow = {"Emission_Color": TINT, "Emission_Strength": 0.3, "Sheen_Weight": 0.5}
    for name, inputs in {"lacquer": red, "metal lacquer": red | {"Metallic": 1.0}, "lit lacquer": red | glow}.items():
        for sockets in (("Coat Normal",), ("Normal", "Coat Normal")):
            found[f"{name} {sockets}"] = lambda tree, i=inputs, s=sockets: waves(tree, 0.5, *principled(**i)[:2], s)
    return found


def material(name, *case):
    """A material of a shader (kind, inputs, properties), or of a function of its tree that returns a shader's output.
    """
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    output = tree.nodes.new('ShaderNodeOutputMaterial')
    tree.links.new(case[0](tree) if callable(case[0]) else shader(tree, *case), output.inputs["Surface"])
    return made


def sheet(scene, found, pixels):
    """A ball and a square of each material, in cells of size 1 around whole numbers, and of so many pixels; the camera
    sees them all.
    """
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=0.45)
    ball = bpy.context.object.data
    for polygon in ball.polygons:
        polygon.use_smooth = True
    bpy.data.objects.remove(bpy.context.object)
    square = bpy.data.meshes.new("square")
    square.from_pydata([(-.4, -.4, -.2), (.4, -.4, .2), (.4, .4, .2), (-.4, .4, -.2)], [], [(0, 1, 2, 3)])
    cell = 0
    for name, case in found.items():
        made = material(name, *(case if isinstance(case, tuple) else (case,)))
        for mesh in (ball.copy(), square.copy()):
            mesh.materials.append(made)
            ob = bpy.data.objects.new(name, mesh)
            ob.location = (cell % COLUMNS - COLUMNS / 2 + 0.5, cell // COLUMNS, 0)
            scene.collection.objects.link(ob)
            cell += 1
    rows = -(-cell // COLUMNS)
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = 'ORTHO', max(rows, COLUMNS)
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location = (0, rows / 2 - 0.5, 10)
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x, scene.render.resolution_y = pixels * COLUMNS, pixels * rows
    return Vector((0, rows / 2 - 0.5, 0))


def exact(scene):
    """Both engines: one ray through the middle of a pixel, direct light only, sharp shadows, linear colours.

    Cycles' box filter would be a pixel wide, whatever its width says.
    """
    ours, cycles = scene.light_meshes, scene.cycles
    ours.shadows, ours.mode, ours.samples = 'SHARP', 'RAY_CASTING', 1
    ours.world_light, ours.bounces = 'AMBIENT', 0
    scene.render.filter_size = 0.0
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = 'CPU', 4, False, False
    cycles.pixel_filter_type, cycles.filter_width, cycles.max_bounces = 'BLACKMAN_HARRIS', 0.01, 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    scene.view_settings.view_transform = 'Standard'
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'IMAGE'
    image.file_format, image.color_depth, image.color_mode = 'OPEN_EXR', '32', 'RGB'


def picture(scene, engine, file):
    scene.render.engine, scene.render.filepath = engine, str(file)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(file))
    pixels = np.array(image.pixels[:], np.float32).reshape(*tuple(image.size)[::-1], -1)[..., :3]
    bpy.data.images.remove(image)
    return pixels


def draw(folder, name, wanted):
    """Mixes and bumps give each other no light and no shadows; mixes have more samples, since Cycles takes one side by
    chance.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, found = bpy.context.scene, {"lobes": cases, "mixes": mixes, "bumps": bumps}[name]()
    middle, alone = sheet(scene, found, CELLS[name]), name in ("mixes", "bumps")
    exact(scene)
    for ob in scene.objects if alone else ():
        ob.visible_diffuse = ob.visible_glossy = ob.visible_transmission = False
    scene.cycles.samples = 64 if name == "mixes" else 4
    for name, part in (w.split(".") for w in wanted):
        kind, properties, place = LAMPS[name]
        data = bpy.data.lights.new(name, kind)
        data.use_shadow = not alone
        for key, value in properties.items():
            setattr(data, key, value)
        lamp = bpy.data.objects.new(name, data)
        lamp.location = middle + Vector(place)
        lamp.rotation_euler = (-Vector(place)).to_track_quat('-Z', 'Y').to_euler()
        scene.collection.objects.link(lamp)
        lamp.visible_diffuse, lamp.visible_glossy = part != "gloss", part != "diffuse"
        for engine, whose in (('LIGHT_MESHES', "ours"), ('CYCLES', "theirs")):
            np.save(folder / f"{name}.{part}.{whose}.npy", picture(scene, engine, folder / "picture.exr"))
        bpy.data.objects.remove(lamp)
    (folder / "cells.json").write_text(json.dumps(list(found)))


def main(folder, *sheets):
    light_meshes_addon.register()
    for name, _, wanted in (s.partition(":") for s in sheets):
        (folder / name).mkdir()
        draw(folder / name, name, wanted.split(","))
    from light_meshes_addon.headless import leave
    light_meshes_addon.unregister()
    leave(0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
