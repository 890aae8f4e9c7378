"""The actions of an artist in a rendered 3D view, as a script for a Blender with a window; test_addon_viewport.py runs
it.

It prints lines "@story " + JSON, one for each action and its result.
"""

import os
import sys
import time
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from viewport_tools import (
    TEMPORARY,
    addon,
    alignment,
    border_error,
    children,
    context,
    context_region,
    files,
    files_of_sessions,
    idle,
    measured,
    mesh_object,
    pixels,
    play,
    resident,
    rotate,
    same_as_fresh,
    space,
    tell,
    view_module,
    viewport,
    viewport_module,
    waiting,
    window,
)

SIDE = int(os.environ.get("STORY_SIDE", "223"))  # squares along a side of the large mesh
SHORT = "STORY_SHORT" in os.environ  # the figures only
UPDATES = 50


@bpy.app.handlers.persistent
def without_eevee(*_):
    """Let the view of a file that has just been read be drawn by Workbench: EEVEE, which is the factory's choice, would
    first compile its shaders, for a minute where there is no graphics card.
    """
    bpy.context.scene.render.engine = 'BLENDER_WORKBENCH'


def story():
    scene = bpy.context.scene
    scene.render.engine = 'LIGHT_MESHES'
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
    scene.light_meshes.samples = 2
    bpy.data.lights["Light"].light_meshes.softness = 'SCENE'  # by nodes, whose step the story tells
    for ob in list(bpy.data.objects):
        if ob.type == 'MESH':
            bpy.data.objects.remove(ob)
    ball = mesh_object("Small", 12, 1.0, 0.2, location=(0, 0, 1.5))
    material = bpy.data.materials.new("Material")
    material.diffuse_color = (0.8, 0.2, 0.1, 1)
    material.use_nodes = False
    ball.data.materials.append(material)
    lamp = bpy.data.objects["Light"]
    n = SIDE
    big = mesh_object("Big", n, 4.0, 0.3)
    big.hide_viewport = True
    other = mesh_object("Other", 9, 1.0, 0.1, location=(0, 0, -1), hide_viewport=True)
    with context():
        bpy.ops.view3d.view_all()
    rotate(0.3)
    yield lambda: waiting()
    waited = [engine._process.pid for engine in waiting()]

    space().shading.type = 'RENDERED'
    yield lambda: len(viewport_module.viewports) == 1
    yield lambda: viewport().pictures
    yield idle
    tell("begin", children=len(children()), waited=children() == waited, waiting=len(waiting()),
         text=viewport()._text, longest=viewport().longest | {})

    def edit():
        ball.data.vertices[5].co.z += 0.5
        ball.data.update()

    def changes(large, i):
        yield from measured(f"first sync{large}", lambda: setattr(big if large else other, "hide_viewport", False))
        yield from measured(f"camera move{large}", lambda: rotate(0.6 + 0.3 * i))
        yield from measured(f"object move{large}", lambda: setattr(ball.location, "x", 1.0 - i))
        yield from measured(f"light move{large}", lambda: setattr(lamp.location, "z", 5.0 + i))
        yield from measured(f"material change{large}", lambda: setattr(material, "diffuse_color", (0.1, i, 0.8, 1)))
        yield from measured(f"mesh edit{large}", edit)
        yield from measured(f"quality{large}", lambda: setattr(scene.light_meshes, "kI", 2.0 - i / 2))
    yield from changes("", 0)
    bpy.data.objects.remove(other)
    yield from changes(" of the large mesh", 1)
    tell("triangles", triangles=2 * n * n)
    yield from same_as_fresh("after changes")
    if SHORT:
        return
    scene.render.preview_pixel_size = '2'  # a quarter of the pixels: what follows asks only whether they are the same
    yield 0.2
    yield idle
    before = pixels().copy()
    with context():
        bpy.ops.object.select_all(action='DESELECT')
        ball.select_set(True)
        window().view_layer.objects.active = ball
    count = viewport().pictures
    yield 0.5
    tell("selection", pictures=viewport().pictures - count)
    with context():
        bpy.ops.ed.undo_push(message="Before")
        bpy.ops.object.mode_set(mode='EDIT')
        bpy.ops.mesh.select_all(action='SELECT')
        bpy.ops.transform.translate(value=(0, 0, 0.7))
    yield 0.5
    yield idle
    tell("edit mode", changed=not np.array_equal(before, pixels()))
    with context():
        bpy.ops.object.mode_set(mode='OBJECT')
        bpy.ops.ed.undo_push(message="Edited")
    yield from same_as_fresh("after edit mode")
    with context():
        bpy.ops.ed.undo()
    yield 0.5
    yield idle
    tell("undo", same=bool(np.array_equal(before, pixels())), mode=bpy.context.mode)
    yield from same_as_fresh("after undo")
    scene = bpy.context.scene
    ball, big, lamp = (bpy.data.objects[name] for name in ("Small", "Big", "Light"))
    material = ball.data.materials[0]

    ball.location.z = 1.5
    ball.keyframe_insert("location", frame=1)
    ball.location.z = 3.0
    ball.keyframe_insert("location", frame=20)
    scene.frame_set(9)
    yield from same_as_fresh("after a frame change")
    big.modifiers.new("Decimate", 'DECIMATE').ratio = 0.4
    copy = ball.copy()
    copy.animation_data_clear()
    copy.location.y = 2
    scene.collection.objects.link(copy)
    yield from same_as_fresh("after modifiers and a new object")
    bpy.data.objects.remove(copy)
    yield from same_as_fresh("after a removal")

    scene.render.preview_pixel_size = 'AUTO'
    data = space().region_3d
    aligned = {}
    data.view_perspective = 'PERSP'
    rotate(-0.4)
    aligned["perspective"] = alignment()
    data.view_perspective = 'ORTHO'
    aligned["orthographic"] = alignment()
    data.view_perspective = 'CAMERA'
    data.view_camera_zoom, data.view_camera_offset = 20, (0.1, -0.05)
    camera = scene.camera.data
    camera.shift_x, camera.lens = 0.2, 35
    yield 0.2
    aligned["camera"] = alignment()
    camera.type = 'ORTHO'
    yield 0.2
    aligned["orthographic camera"] = alignment()
    render = scene.render
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.2, 0.7, 0.3, 0.9
    yield 0.2
    tell("alignment", **aligned)
    borders = {"orthographic camera": border_error()}
    camera.type = 'PERSP'
    yield 0.2
    borders["camera"] = border_error()
    tell("border", **borders)
    yield idle
    with context():
        corners = view_module.current(bpy.context, scene, bpy.context.evaluated_depsgraph_get()).corners
    tell("border picture", shape=pixels().shape, corners=corners)
    render.use_border = False
    render.preview_pixel_size = '4'
    yield 0.2
    yield idle
    tell("pixel size", shape=pixels().shape, region=[context_region().width, context_region().height])
    dof = camera.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, 0.1, 3
    yield 0.2
    with context():
        seen = view_module.current(bpy.context, scene, bpy.context.evaluated_depsgraph_get()).camera
    tell("lens", radius=seen["lens_radius"], focus=seen["focus_distance"])
    dof.use_dof = False
    data.view_perspective = 'PERSP'

    render.resolution_x, render.resolution_y = 64, 48
    picture = TEMPORARY / "f12.png"
    render.filepath = str(picture)
    yield 0.2
    yield idle
    held = len(children())
    bpy.ops.render.render(write_still=True)
    tell("render beside it", written=picture.exists(), before=held, children=len(children()),
         h=[viewport_module.session.statistics["h"], viewport().statistics["h"]])
    picture.unlink(missing_ok=True)
    viewport_module.session.end()

    big.hide_viewport = True
    camera, scene.camera = scene.camera, None
    yield from same_as_fresh("without a camera")
    steps = []
    for angle in (0.1, 0.9):
        rotate(angle)
        yield 0.2
        yield idle
        steps.append(viewport().statistics["h"])
    tell("step without a camera", h=steps)
    scene.camera = camera
    with context():
        bpy.ops.view3d.localview()
    yield from same_as_fresh("in local view")
    with context():
        bpy.ops.view3d.localview()
    render.preview_pixel_size = 'AUTO'
    yield 0.2
    yield idle
    sizes = []
    for i in range(UPDATES):
        count = viewport().pictures
        kind = i % 5
        if kind == 0:
            rotate(0.01 * i)
        elif kind == 1:
            ball.data.vertices[i % 100].co.z += 0.1
            ball.data.update()
        elif kind == 2:
            lamp.location.x += 0.01
        elif kind == 3:
            material.diffuse_color = (0.001 * i, 0.5, 0.5, 1)
        else:
            ball.location.y += 0.01
        yield (lambda count=count: viewport().pictures > count) if i % 2 else 0.03
        if i in (UPDATES // 4, UPDATES - 1):
            yield idle
            yield 0.3
            sizes.append([len(children()), files(), resident(children()[0]), resident(os.getpid())])
    tell("updates", sizes=sizes, longest=viewport().longest)
    yield from same_as_fresh("after many updates")

    scene.light_meshes.auto_h = False
    yield idle

    space().shading.type = 'SOLID'
    yield lambda: not children()
    tell("closed", viewports=len(viewport_module.viewports), files=files_of_sessions())
    yield lambda: waiting()
    space().shading.type = 'RENDERED'
    yield lambda: children()
    scene.render.engine = 'BLENDER_WORKBENCH'
    yield lambda: not children() and not waiting()
    scene.render.engine = 'LIGHT_MESHES'
    yield lambda: children()
    bpy.app.handlers.load_post.append(without_eevee)
    bpy.ops.wm.read_homefile(use_factory_startup=True, load_ui=False)
    yield lambda: not children()
    tell("another file", viewports=len(viewport_module.viewports), files=files_of_sessions())
    bpy.context.scene.render.engine = 'LIGHT_MESHES'
    space().shading.type = 'RENDERED'
    yield lambda: viewport_module.viewports and viewport().pictures
    import addon_utils
    addon_utils.disable(addon)
    while children():  # without a drawing in between, for which EEVEE would compile its shaders
        time.sleep(0.05)
    tell("switched off")
    addon_utils.enable(addon)
    bpy.context.scene.render.engine = 'LIGHT_MESHES'
    yield lambda: children()


play(story)
