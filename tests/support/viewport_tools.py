"""Functions for the stories that use a rendered 3D view of a Blender with a window, and look at it."""

import json
import os
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

addon = next(name[:-len(".viewport")] for name in sys.modules if name.endswith("light_meshes.viewport"))
viewport_module, screen, view_module, session = (
    sys.modules[f"{addon}.{name}"] for name in ("viewport", "screen", "view", "session"))
TEMPORARY = Path(os.environ["TMPDIR"])
PATIENCE = 300  # seconds for one step
_last = {}  # the pixels that were shown last
log = []  # "put" and "drawn", in order
_put, _draw = screen.Picture.put, screen.Picture.draw


def put(self, pixels, corners):
    _last[id(self)] = pixels
    log.append("put")
    _put(self, pixels, corners)


def draw(self, *rest):
    if not bare(self):
        log.append("drawn")
    _draw(self, *rest)


def bare(picture):
    """Return whether there is nothing to draw."""
    return picture._pixels is None and picture._texture is None


screen.Picture.put, screen.Picture.draw = put, draw


def tell(what, **found):
    print("@story " + json.dumps({"what": what} | found), flush=True)


def window():
    return bpy.context.window_manager.windows[0]


def area():
    return next(a for a in window().screen.areas if a.type == 'VIEW_3D')


def space():
    return area().spaces.active


def context():
    region = next(r for r in area().regions if r.type == 'WINDOW')
    return bpy.context.temp_override(window=window(), screen=window().screen, area=area(), region=region,
                                     space_data=space(), region_data=space().region_3d)


def viewport():
    (found,) = viewport_module.viewports
    return found


def idle():
    return not viewport()._exporting and not viewport()._waits


def pixels():
    return _last[id(viewport()._picture)]


def waiting():
    """Return the engines that wait for work, which nobody uses yet: one at most."""
    found = list(session._waiting)
    assert len(found) <= 1
    return found


def children():
    """Return the engines that are in use."""
    command = ["ps", "-A", "-ww", "-o", "pid=,ppid=,args="]  # whole lines, whatever COLUMNS says
    table = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    rows = [line.split(None, 2) for line in table.splitlines()]
    return [int(p) for p, parent, command in rows
            if int(parent) == os.getpid() and "light_meshes.frontends.service" in command
            and int(p) not in [s._process.pid for s in waiting()]]


def resident(pid):
    """Return the memory of a process in megabytes."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def processor(pid):
    """Return the seconds of processor time that a process and its threads used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def files():
    """Return the files and folders in the folder shared with the engine."""
    return sum(1 for _ in TEMPORARY.rglob("*"))


def mesh_object(name, n, size, height, **properties):
    """Make a wavy sheet of 2·n² triangles."""
    x, y = np.meshgrid(np.linspace(-size, size, n + 1), np.linspace(-size, size, n + 1))
    z = height * np.sin(5 * x) * np.cos(4 * y)
    i = np.arange((n + 1) ** 2, dtype=np.int32).reshape(n + 1, n + 1)
    quads = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]], -1).reshape(-1)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(x.size)
    mesh.vertices.foreach_set("co", np.stack([x, y, z], -1).astype(np.float32).ravel())
    mesh.loops.add(len(quads))
    mesh.loops.foreach_set("vertex_index", quads)
    mesh.polygons.add(n * n)
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(quads), 4, dtype=np.int32))
    mesh.update()
    mesh.validate()
    ob = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(ob)
    for key, value in properties.items():
        setattr(ob, key, value)
    return ob


def measured(what, change):
    """Carry out `change`, and report how long the first picture took and the longest time for which Blender had to
    wait.
    """
    view = viewport()
    view.longest.clear()
    before, (engine,) = view.pictures, children()
    start, busy = time.perf_counter(), processor(engine)
    change()
    while view.pictures == before:
        yield None
    first, busy = time.perf_counter() - start, processor(engine) - busy
    yield idle
    tell(what, first=first, engine=busy, whole=time.perf_counter() - start, longest=view.longest | {})


def same_as_fresh(what):
    """Report whether the picture has the same bits as that of a view that starts again."""
    yield idle
    shown = pixels().copy()
    space().shading.type = 'SOLID'
    yield lambda: not viewport_module.viewports
    space().shading.type = 'RENDERED'
    yield lambda: viewport_module.viewports and viewport().pictures
    yield idle
    tell(what, same=bool(np.array_equal(shown, pixels())), largest=float(np.abs(shown - pixels()).max()))


def rotate(angle):
    space().region_3d.view_rotation = Euler((1.0, 0, angle)).to_quaternion()


def alignment():
    """Return the largest distance, in pixels, between the places of the same points in Blender's overlays and in the
    engine's camera.
    """
    with context():
        region, data = bpy.context.region, bpy.context.region_data
        data.update()
        scene = bpy.context.scene
        found = view_module.current(bpy.context, scene, bpy.context.evaluated_depsgraph_get()).camera
        worst = 0.0
        matrix = np.linalg.inv(np.array(found["matrix"]))
        left, right, bottom, top = found["window"]
        for point in np.random.default_rng(1).uniform(-1.5, 1.5, (50, 3)):
            theirs = location_3d_to_region_2d(region, data, Vector(point))
            x, y, z = (matrix @ [*point, 1])[:3]
            if theirs is None or (found["perspective"] and z >= 0):
                continue
            scale = -z if found["perspective"] else 1
            ours = ((x / scale - left) / (right - left) * region.width, (y / scale - bottom) / (top - bottom)
                    * region.height)
            worst = max(worst, abs(ours[0] - theirs[0]), abs(ours[1] - theirs[1]))
    return worst


def border_error():
    """Return the same between the corners of the render border and those of the picture."""
    with context():
        scene, region, data = bpy.context.scene, bpy.context.region, bpy.context.region_data
        data.update()
        camera, render = scene.camera, scene.render
        frame = [camera.matrix_world @ v for v in camera.data.view_frame(scene=scene)]
        low, high = (location_3d_to_region_2d(region, data, frame[i]) for i in (2, 0))
        x = [low[0] + (high[0] - low[0]) * b for b in (render.border_min_x, render.border_max_x)]
        y = [low[1] + (high[1] - low[1]) * b for b in (render.border_min_y, render.border_max_y)]
        corners = view_module.current(bpy.context, scene, bpy.context.evaluated_depsgraph_get()).corners
    return max(abs(a - b) for a, b in zip(corners, (x[0], y[0], x[1], y[1]), strict=True))


def context_region():
    return next(r for r in area().regions if r.type == 'WINDOW')


def files_of_sessions():
    return [p.name for p in TEMPORARY.glob("light-meshes-*") if p not in [s.folder for s in waiting()]]


def play(story):
    """Play a story in Blender's timers. The story yields seconds to wait, or a condition that must become true.

    Blender draws no grid, whose every pixel takes the processor long where there is no graphics card.
    """
    space().overlay.show_floor = space().overlay.show_axis_x = space().overlay.show_axis_y = False
    space().show_gizmo = False
    steps = story()
    waits_for, since = None, 0.0

    def tick():
        nonlocal waits_for, since
        try:
            now = time.monotonic()
            if isinstance(waits_for, float):
                if now - since < waits_for:
                    return 0.01
            elif waits_for and not waits_for():
                if now - since > PATIENCE:
                    raise TimeoutError([(v._text, v.longest) for v in viewport_module.viewports])
                return 0.01
            waits_for, since = next(steps), now
            return 0.0
        except StopIteration:
            tell("end")
        except BaseException:
            tell("failed", why=traceback.format_exc(), at=steps.gi_frame and str(steps.gi_yieldfrom or steps.gi_frame))
        bpy.ops.wm.quit_blender()
        return None
    bpy.app.timers.register(tick, first_interval=1.0, persistent=True)
