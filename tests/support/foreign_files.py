"""Files that others made, beside Cycles: python tests/support/foreign_files.py FOLDER FILE …, in a Python with bpy.

Each FILE (.blend, .glb, .gltf, .fbx, .obj, .ply, .stl, .usd) is opened or imported by Blender's importers, seen
by a camera from one side, and lit by a sun and a lamp of its own; direct light only, nothing mirrored. Both engines'
pictures are written side by side to FOLDER/NAME.png. Printed are the warnings, and the relative difference of what is
lit: the median and the 95th percentile, and the share of pixels that differ by more than 5 %; once with shadows and
once without, where what is left is that of materials and of edges.
"""

import sys
import tempfile
from pathlib import Path

import bpy
import light_meshes_addon
import numpy as np
from mathutils import Vector

IMPORT = {".glb": lambda f: bpy.ops.import_scene.gltf(filepath=f),
          ".gltf": lambda f: bpy.ops.import_scene.gltf(filepath=f),
          ".fbx": lambda f: bpy.ops.import_scene.fbx(filepath=f), ".obj": lambda f: bpy.ops.wm.obj_import(filepath=f),
          ".ply": lambda f: bpy.ops.wm.ply_import(filepath=f), ".stl": lambda f: bpy.ops.wm.stl_import(filepath=f),
          ".usd": lambda f: bpy.ops.wm.usd_import(filepath=f), ".usdc": lambda f: bpy.ops.wm.usd_import(filepath=f)}


def opened(file):
    """Return the scene with the file's objects, without its lamps and cameras."""
    if file.suffix == ".blend":
        bpy.ops.wm.open_mainfile(filepath=str(file))
    else:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        IMPORT[file.suffix.lower()](str(file))
    scene = bpy.context.scene
    for ob in list(scene.objects):
        if ob.type in ('LIGHT', 'CAMERA'):
            bpy.data.objects.remove(ob)
    return scene


def placed(scene):
    """Put a camera before the objects, and lamps beside it."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    corners = [ob.matrix_world @ Vector(c) for ob in (o.evaluated_get(depsgraph) for o in scene.objects)
               if ob.type in ('MESH', 'CURVE', 'SURFACE', 'FONT') and not ob.hide_render for c in ob.bound_box]
    low, high = (Vector(f(c[i] for c in corners) for i in range(3)) for f in (min, max))
    middle, size = (low + high) / 2, max((high - low).length, 1e-6)
    for kind, data, way in (('CAMERA', bpy.data.cameras.new("Camera"), (0.6, -1.0, 0.6)),
                            ('SUN', bpy.data.lights.new("Sun", 'SUN'), (-0.4, -0.6, 1.0)),
                            ('POINT', bpy.data.lights.new("Lamp", 'POINT'), (1.0, -0.3, 0.5))):
        ob = bpy.data.objects.new(kind, data)
        ob.location = middle + Vector(way).normalized() * size * 1.6
        ob.rotation_euler = (middle - ob.location).to_track_quat('-Z', 'Y').to_euler()
        scene.collection.objects.link(ob)
        if kind == 'CAMERA':
            scene.camera, data.lens, data.clip_start, data.clip_end = ob, 60, size / 100, size * 10
        elif kind == 'SUN':
            data.energy, data.angle = 2.5, 0.0
        else:
            data.energy, data.shadow_soft_size, data.light_meshes.softness = 40 * size**2, 0.1 * size, 'SIZE'


def exact(scene):
    """Direct light only, one colour space, the same samples."""
    scene.world = None
    render, ours, cycles = scene.render, scene.light_meshes, scene.cycles
    render.resolution_x, render.resolution_y, render.resolution_percentage, render.use_border = 300, 300, 100, False
    render.use_compositing = render.use_sequencer = render.film_transparent = False
    render.filter_size = 0.0  # both engines look at pixels' middles
    scene.view_settings.view_transform, scene.view_settings.exposure, scene.view_settings.gamma = 'Standard', 0, 1
    ours.samples, ours.mode, ours.world_light, ours.bounces = 1, 'RAY_CASTING', 'AMBIENT', 0
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = 'CPU', 128, False, False
    cycles.pixel_filter_type, cycles.filter_width = 'BLACKMAN_HARRIS', 0.01
    cycles.max_bounces, cycles.transparent_max_bounces = 0, 16
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    image = render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'IMAGE'
    image.file_format, image.color_depth, image.color_mode = 'OPEN_EXR', '32', 'RGB'


def picture(scene, engine, folder):
    scene.render.engine, scene.render.filepath = engine, str(Path(folder) / "picture.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.array(image.pixels[:], np.float32).reshape(*tuple(image.size)[::-1], -1)[..., :3]
    bpy.data.images.remove(image)
    return pixels


def written(pixels, file):
    """Save rows of linear pixels, the lowest first, as a PNG."""
    image = bpy.data.images.new("both", pixels.shape[1], pixels.shape[0], float_buffer=False)
    shown = np.ones((*pixels.shape[:2], 4), np.float32)
    shown[..., :3] = np.clip(pixels, 0, 1) ** (1 / 2.2)
    image.pixels.foreach_set(shown.ravel())
    image.filepath_raw, image.file_format = str(file), 'PNG'
    image.save()
    bpy.data.images.remove(image)


def compared(file, folder):
    scene = opened(file)
    placed(scene)
    exact(scene)
    name = f"{file.parent.name}-{file.stem}"
    for shadows in (True, False):
        for ob in scene.objects:
            if ob.type == 'LIGHT':
                ob.data.use_shadow = shadows
        with tempfile.TemporaryDirectory() as place:
            ours, theirs = picture(scene, 'LIGHT_MESHES', place), picture(scene, 'CYCLES', place)
        written(np.concatenate([ours, theirs], axis=1), folder / f"{name}{'' if shadows else ' without shadows'}.png")
        bright = theirs.max(2)
        lit = bright > 0.02 * np.quantile(bright, 0.99)
        off = (np.abs(ours - theirs).max(2) / np.maximum(bright, 0.02))[lit]
        print(f"= {name}, {'with' if shadows else 'without'} shadows: median {np.median(off):.2%}, 95 % "
              f"{np.quantile(off, 0.95):.2%}, {(off > 0.05).mean():.1%} of {lit.sum():,} pixels beyond 5 %", flush=True)


if __name__ == "__main__":
    light_meshes_addon.register()
    Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
    for argument in sys.argv[2:]:
        try:
            compared(Path(argument), Path(sys.argv[1]))
        except Exception as error:
            print(f"= {argument}: {error!r}", flush=True)
    light_meshes_addon.unregister()
    from light_meshes_addon.headless import leave

    leave(0)
