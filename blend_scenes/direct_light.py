"""Render direct light with Cycles. `light-meshes bench` runs this in a separate Blender and talks to it in lines of
text.

Each line on stdin is a JSON object: file (a .blend), lights {name: radius, a sun's angle, or null for the size in the
file}, power (a factor for all lights), width, height, samples, seed, picture (an .exr to write, or null), denoise
(optional; OpenImageDenoise with albedo and normals), and window (optional; left, bottom, right, top of the part that is
rendered, 0 to 1). The answer is a line "@light-meshes " + JSON with two times:
`sampling`, the seconds from before the first sample to after the last and the denoiser, without export and acceleration
structure; and `whole`, the seconds of Blender's render operator.

Only direct light is computed, on the CPU, without adaptive sampling, with a black world and rays through the centre of
each pixel.
"""

import json
import os
import sys
import time

import bpy

MARK = "@light-meshes "
says = []  # (time, Cycles' message about what it does)


@bpy.app.handlers.persistent
def listen(*arguments):
    says.append((time.perf_counter(), str(arguments[0])))


def prepare(scene, request):
    scene.render.engine = 'CYCLES'
    cycles = scene.cycles
    cycles.device, cycles.use_adaptive_sampling, cycles.use_denoising = 'CPU', False, False
    if request.get("denoise"):
        cycles.use_denoising, cycles.denoiser = True, 'OPENIMAGEDENOISE'
        cycles.denoising_input_passes = 'RGB_ALBEDO_NORMAL'
        if hasattr(cycles, "denoising_use_gpu"):
            cycles.denoising_use_gpu = False
    cycles.samples, cycles.seed = request["samples"], request["seed"]
    cycles.pixel_filter_type, cycles.filter_width = 'BLACKMAN_HARRIS', 0.01  # not BOX, which is always one pixel wide
    cycles.max_bounces = 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    render = scene.render
    render.threads_mode, render.threads = 'FIXED', os.cpu_count()
    window = request.get("window")
    render.use_border = render.use_crop_to_border = window is not None
    if window is not None:
        render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y = window
    render.resolution_x, render.resolution_y, render.resolution_percentage = request["width"], request["height"], 100
    scene.world = None
    for ob in [ob for ob in scene.objects if ob.type == 'LIGHT']:
        ob.hide_render = ob.name not in request["lights"]
        if not ob.hide_render:
            ob.data.energy *= request["power"]
            radius = request["lights"][ob.name]
            if radius is not None:
                setattr(ob.data, "angle" if ob.data.type == 'SUN' else "shadow_soft_size", radius)
    image = render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'IMAGE'  # 5.0+
    image.file_format, image.color_depth, image.color_mode = 'OPEN_EXR', '32', 'RGB'
    render.use_file_extension = False


def answer(request):
    bpy.ops.wm.open_mainfile(filepath=request["file"])
    scene = bpy.context.scene
    prepare(scene, request)
    if request["picture"]:
        scene.render.filepath = request["picture"]
    says.clear()
    started = time.perf_counter()
    bpy.ops.render.render(write_still=bool(request["picture"]))
    whole = time.perf_counter() - started
    first = [when for when, what in says if "| Sample 0/" in what]
    last = [when for when, what in says if "| Finished" in what]
    return {"sampling": last[-1] - first[0], "whole": whole, "version": bpy.app.version_string}


if __name__ == "__main__":
    bpy.app.handlers.render_stats.append(listen)
    for line in sys.stdin:
        print(MARK + json.dumps(answer(json.loads(line))), flush=True)
    sys.stdout.flush()
    os._exit(0)  # some bpy crash or hang at exit
