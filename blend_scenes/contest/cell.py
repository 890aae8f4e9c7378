"""Render one cell of the contest in a Blender of its own: `python cell.py REQUEST.json`, or `blender -b
--factory-startup -P cell.py -- REQUEST.json`. `light-meshes contest` runs this.

The request is a JSON object: file (a .blend), engine (LIGHT_MESHES, CYCLES, or GUIDES), level (of this engine:
DRAFT, BALANCED, FINE), samples, denoise and reference (of Cycles), width, height, frames, threads, output (a folder for
frame_NNNN.exr and .png), addon (the add-on's folder). The answer is written to OUTPUT/result.json.

For each frame it has the seconds of Blender's render operator, with the export, all preparing and the denoiser; the
processor seconds of this process and its children meanwhile; and the matrix from a place in the world to a pixel.
GUIDES are Cycles' passes of what is at the pixels' centres.
"""

import contextlib
import importlib.util
import json
import os
import sys
import time
from pathlib import Path

import bpy
from mathutils import Matrix

LEVELS = ("DRAFT", "BALANCED", "FINE")


def load_addon(folder):
    """Register this checkout's add-on, also in a Blender that does not have it installed."""
    name = "light_meshes_addon"
    if importlib.util.find_spec(name) is None:
        spec = importlib.util.spec_from_file_location(
            name, Path(folder) / "__init__.py", submodule_search_locations=[folder]
        )
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    importlib.import_module(name).register()


def processor_seconds():
    """Return the processor seconds of this process and all below it; on systems without /proc of this one alone."""
    if not Path("/proc/self/stat").exists():
        return time.process_time()
    parents, spent = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            values = stat.read_text().rpartition(")")[2].split()
            parents[int(stat.parent.name)] = int(values[1])
            spent[int(stat.parent.name)] = sum(map(int, values[11:15]))
    ours = {os.getpid()}
    while more := {child for child, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return sum(spent.get(process, 0) for process in ours) / os.sysconf("SC_CLK_TCK")


def bounces(scene):
    """Give Cycles the bounces of this engine at Balanced: those of diffuse light where it has them, and of mirrors.
    Light goes through as much glass as in a new file, as here it goes through any.
    """
    bpy.ops.light_meshes.preset(level='BALANCED')
    own, cycles = scene.light_meshes, scene.cycles
    cycles.diffuse_bounces = int(getattr(own, "bounces", 0))
    cycles.glossy_bounces = own.max_depth
    cycles.transmission_bounces = cycles.max_bounces = max(12, own.max_depth)
    cycles.volume_bounces = 0


def prepare(scene, request):
    render, cycles = scene.render, scene.cycles
    render.resolution_x, render.resolution_y, render.resolution_percentage = request["width"], request["height"], 100
    render.threads_mode, render.threads = 'FIXED', request["threads"]
    render.use_border = render.use_compositing = render.use_sequencer = False
    render.use_persistent_data = len(request["frames"]) > 1  # as for an animation
    if request["engine"] == 'LIGHT_MESHES':
        render.engine = 'LIGHT_MESHES'
        bpy.ops.light_meshes.preset(level=request["level"])
        return
    bounces(scene)
    render.engine, cycles.device = 'CYCLES', 'CPU'
    cycles.samples, cycles.use_adaptive_sampling = request["samples"], False
    cycles.use_animated_seed, cycles.seed = True, 1 if request["reference"] else 0
    cycles.use_denoising = request["denoise"]
    if request["denoise"]:
        cycles.denoiser, cycles.denoising_input_passes = 'OPENIMAGEDENOISE', 'RGB_ALBEDO_NORMAL'
        if hasattr(cycles, "denoising_use_gpu"):
            cycles.denoising_use_gpu = False
    if request["reference"]:
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    if request["engine"] == 'GUIDES':
        guide(scene)


def guide(scene):
    """One ray through the centre of each pixel, and the passes that say what it meets."""
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = 'BLACKMAN_HARRIS', 0.01
    layer = scene.view_layers[0]
    layer.use_pass_position = layer.use_pass_normal = layer.use_pass_object_index = layer.use_pass_z = True
    for n, ob in enumerate(scene.objects):
        ob.pass_index = 1 + n % 32000
    for lamp in [ob for ob in scene.objects if ob.type == 'LIGHT']:  # not needed, and many take long
        bpy.data.objects.remove(lamp)


def file_format(scene, kind):
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'MULTI_LAYER_IMAGE' if kind == 'OPEN_EXR_MULTILAYER' else 'IMAGE'  # 5.0+
    image.file_format = kind
    image.color_mode, image.color_depth = 'RGB', '8' if kind == 'PNG' else '32'


def to_pixel(scene):
    """Return the matrix from a place in the world to (x, y, ·, w) of a pixel, y from above."""
    width, height = scene.render.resolution_x, scene.render.resolution_y
    camera, graph = scene.camera, bpy.context.evaluated_depsgraph_get()
    clip = camera.calc_matrix_camera(graph, x=width, y=height) @ camera.matrix_world.inverted()
    screen = Matrix(((width / 2, 0, 0, width / 2), (0, -height / 2, 0, height / 2), (0, 0, 1, 0), (0, 0, 0, 1)))
    return [list(row) for row in screen @ clip]


def frame(scene, request, number):
    """Render a frame, write its pictures, and return what is known of it."""
    scene.frame_set(number)
    guides = request["engine"] == 'GUIDES'
    path = Path(request["output"]) / f"frame_{number:04}"
    scene.render.use_file_extension = False
    scene.render.filepath = str(path.with_suffix(".exr"))
    if guides:
        file_format(scene, 'OPEN_EXR_MULTILAYER')
    spent, started = processor_seconds(), time.perf_counter()
    bpy.ops.render.render(write_still=guides)
    done = {
        "frame": number,
        "seconds": time.perf_counter() - started,
        "processor": processor_seconds() - spent,
        "to_pixel": to_pixel(scene),
    }
    if not guides:
        result = bpy.data.images["Render Result"]
        for kind, suffix in (('OPEN_EXR', ".exr"), ('PNG', ".png")):
            file_format(scene, kind)
            result.save_render(str(path.with_suffix(suffix)), scene=scene)
    return done


def main(path):
    request = json.loads(Path(path).read_text())
    load_addon(request["addon"])
    from light_meshes_addon.observers import observers

    told = {"warnings": [], "errors": [], "statistics": {}}

    def listen(event):
        if event["event"] in ("warning", "error"):
            told[event["event"] + "s"].append(event["message"])
        elif event["event"] == "statistics":
            told["statistics"] = event["statistics"]

    observers.append(listen)
    bpy.ops.wm.open_mainfile(filepath=request["file"])
    scene = bpy.context.scene
    prepare(scene, request)
    frames = [frame(scene, request, number) for number in request["frames"]]
    if told["errors"]:
        raise RuntimeError(told["errors"][0])
    answer = {"frames": frames, "version": bpy.app.version_string, "exposure": scene.view_settings.exposure, **told}
    (Path(request["output"]) / "result.json").write_text(json.dumps(answer))


if __name__ == "__main__":
    main((sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])[0])
    sys.stdout.flush()
    os._exit(0)  # some bpy crash or hang at exit
