"""Measure Cycles' microfiber sheen: python tests/support/sheen_table.py [FILE], in a Python with bpy.

Writes engine/light_meshes/surface/sheen_table.h, or FILE: the three numbers by which T. Zeltner, B. Burley and M. J.-Y.
Chiang (Practical multiple-scattering sheen using linearly transformed cosines, SIGGRAPH Talks 2022) describe the light
that a layer of fibres returns, for roughness and the cosine of the eye. Squares of a white Sheen BSDF, each tilted by
another angle, are lit from forty directions. Of each the reflectance f gives √(cos/f), which is linear in three numbers
from which those wanted follow.
"""

import os
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

N, CELL = 32, 4  # numbers along a side of the table, pixels along one of a square
FILE = Path(__file__).parents[2] / "engine" / "light_meshes" / "surface" / "sheen_table.h"
COSINE = np.clip(np.linspace(0, 1, N), 0.004, 0.99999)
SINE, ROUGHNESS = np.sqrt(1 - COSINE**2), np.linspace(0, 1, N)
LIGHTS = [(np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up))
          for up in np.radians([3, 12, 25, 40, 55, 68, 78, 86]) for around in np.radians([0, 45, 90, 135, 180])]


def squares(scene):
    """A square for each roughness (from below) and each tilt (from the left), with sides of 1 in the picture."""
    for row, roughness in enumerate(ROUGHNESS):
        material = bpy.data.materials.new("Sheen")
        if bpy.app.version < (5, 0):
            material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        sheen, output = tree.nodes.new('ShaderNodeBsdfSheen'), tree.nodes.new('ShaderNodeOutputMaterial')
        sheen.inputs["Color"].default_value, sheen.inputs["Roughness"].default_value = (1, 1, 1, 1), roughness
        tree.links.new(sheen.outputs[0], output.inputs["Surface"])
        for column, (sine, cosine) in enumerate(zip(SINE, COSINE, strict=True)):
            mesh, rise = bpy.data.meshes.new("Square"), 0.5 * sine / cosine
            mesh.from_pydata([(-.5, -.5, rise), (.5, -.5, -rise), (.5, .5, -rise), (-.5, .5, rise)], [], [(0, 1, 2, 3)])
            mesh.materials.append(material)
            square = bpy.data.objects.new("Square", mesh)
            square.location = (column + 0.5, row + 0.5, 0)
            scene.collection.objects.link(square)


def prepared():
    """Return the scene, and its sun without shadows, which gives a white matt surface that faces it the radiance 1."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    squares(scene)
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale, camera.clip_end = 'ORTHO', N, 1000
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location = (N / 2, N / 2, 300)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", 'SUN'))
    sun.data.energy, sun.data.angle, sun.data.use_shadow = np.pi, 0, False
    for ob in (scene.camera, sun):
        scene.collection.objects.link(ob)
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = 'CYCLES', N * CELL, N * CELL
    cycles = scene.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising, cycles.max_bounces = 1, False, False, 0
    cycles.pixel_filter_type, cycles.filter_width = 'BLACKMAN_HARRIS', 0.01
    scene.view_settings.view_transform = 'Standard'
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'IMAGE'
    image.file_format, image.color_depth = 'OPEN_EXR', '32'
    return scene, sun


def measured(scene, sun, light):
    """π·f·cos of all squares (roughness, cosine) in the light from a direction."""
    sun.rotation_euler = Vector(light).to_track_quat('Z', 'Y').to_euler()
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "picture.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        pixels = np.array(image.pixels[:]).reshape(N, CELL, N, CELL, -1)
        bpy.data.images.remove(image)
    return pixels[:, 1, :, 1, 0]


def solved(lights, found):
    """A, B and R (roughness, cosine), see layers.h; 0 where nothing comes back."""
    lights, table = np.array(lights), np.zeros((3, N, N))
    up = lights[:, :1] * SINE + lights[:, 2:] * COSINE
    along = (lights[:, 2:] - COSINE * up) / SINE
    for column in range(N):
        z, x = up[:, column], along[:, column]
        for row in range(N):
            f = found[:, row, column]
            lit = (z > 0.02) & (f > 1e-9)
            if lit.sum() < 6:
                continue
            z_, x_ = z[lit], x[lit]
            root = np.sqrt(f[lit] / z_)
            terms = np.stack([1 - z_**2, x_ * z_, z_**2], 1) * root[:, None]
            first, second, third = np.linalg.lstsq(terms, np.ones(len(root)), rcond=None)[0]
            lean = second / (2 * first)
            A = 1 / np.sqrt(max(third / first - lean**2, 1e-12))
            table[:, row, column] = A, A * lean, (A / first)**2
    return table


def main(file):
    scene, sun = prepared()
    table = solved(LIGHTS, np.array([measured(scene, sun, light) for light in LIGHTS]))
    lines = ["/* What a layer of fibres returns (layers.h): A, B and R, by roughness and by the cosine of the eye,",
             "   both from 0 to 1. Made by tests/support/sheen_table.py. */", "#pragma once", "",
             f"enum {{ SHEEN_SIDE = {N} }};", "static const float sheen_table[3][SHEEN_SIDE][SHEEN_SIDE] = {"]
    for part in table:
        lines.append("    {")
        for row in part:
            numbers = [f"{x:.4g}".replace("0.", ".", 1) if abs(x) < 1 else f"{x:.4g}" for x in row]
            numbers = [n if "." in n or "e" in n else n + "." for n in numbers]
            rows = ",\n         ".join(", ".join(numbers[i:i + 12]) for i in range(0, N, 12))
            lines.append("        {" + rows + "},")
        lines.append("    },")
    file.write_text("\n".join([*lines, "};", ""]))
    sys.stdout.flush()
    os._exit(0)  # some bpy crash or hang at exit


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
