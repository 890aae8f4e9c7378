"""Open every tab of the properties editor in Blender's window with all panels unfolded, and use the buttons.

It prints "DREW panel" for each of our panels and "SAW …" for the results of the buttons. An error in a panel appears as
Blender's traceback.
"""

import contextlib
import sys
import traceback
from pathlib import Path

import bpy

OWN = next(name for name in sys.modules if name.endswith("light_meshes"))
ui, session = sys.modules[f"{OWN}.ui"], sys.modules[f"{OWN}.session"]
FOLDER = Path(sys.argv[-1])
drawn = set()
shown = {}  # the statistics that the panels were last drawn with


def scene():
    """All kinds of objects whose properties have panels, and a small picture."""
    bpy.context.scene.render.engine = 'LIGHT_MESHES'
    bpy.context.scene.render.resolution_percentage = 5
    for kind in ('SUN', 'SPOT', 'AREA'):
        bpy.ops.object.light_add(type=kind, location=(0, 0, 5))
        bpy.context.object.name = kind
    bpy.data.lights[-1].light_meshes.softness = 'RADIUS'
    unfold()
    area = max(bpy.context.window_manager.windows[0].screen.areas, key=lambda a: a.width * a.height)
    area.ui_type = 'PROPERTIES'


def unfold():
    ui.unregister()
    visibility = bpy.types.OBJECT_PT_visibility  # Blender's own, in which one of ours lies
    bpy.utils.unregister_class(visibility)
    visibility.bl_options = set()
    bpy.utils.register_class(visibility)
    for panel in ui._CLASSES:
        panel.bl_options = set()
        panel.fill = noted(panel.__name__, panel.fill)
    ui.register()


def noted(name, fill):
    def run(self, layout, context):
        fill(self, layout, context)
        if name == "LIGHT_MESHES_PT_last_render":
            shown["last"] = session.statistics
        if name not in drawn:
            drawn.add(name)
            print("DREW", name, flush=True)
    return run


def tab(name, active=None):
    def run():
        if active:
            bpy.context.view_layer.objects.active = bpy.data.objects[active]
        for area in bpy.context.window_manager.windows[0].screen.areas:
            if area.ui_type == 'PROPERTIES':
                area.spaces.active.context = name
                area.tag_redraw()
    return run


def shader_editor(active):
    """Its sidebar, where Blender has the panels of materials and lamps, too."""
    def run():
        bpy.context.view_layer.objects.active = bpy.data.objects[active]
        area = max(bpy.context.window_manager.windows[0].screen.areas, key=lambda a: a.width * a.height)
        area.ui_type = 'ShaderNodeTree'
        area.spaces.active.show_region_ui = True
        area.tag_redraw()
    return run


def options(panel):
    """Show that tab of the sidebar, which has tabs once it has been drawn, until `panel` is drawn."""
    tries = iter(range(60))

    def run():
        if panel in drawn or next(tries, None) is None:
            return None
        area = max(bpy.context.window_manager.windows[0].screen.areas, key=lambda a: a.width * a.height)
        with contextlib.suppress(AttributeError):
            next(r for r in area.regions if r.type == 'UI').active_panel_category = "Options"
        area.tag_redraw()
        return "again"
    return run


def press(operator, call='EXEC_DEFAULT', **arguments):
    def run():
        window = bpy.context.window_manager.windows[0]
        area = max(window.screen.areas, key=lambda a: a.width * a.height)
        with bpy.context.temp_override(window=window, area=area, region=area.regions[-1]):
            module, name = operator.split(".")
            getattr(getattr(bpy.ops, module), name)(call, **arguments)
    return run


def softened():
    print("SAW softness", sorted({light.light_meshes.softness for light in bpy.data.lights}), flush=True)


def rendered():
    print("SAW render", session.statistics["width"], flush=True)


def in_the_background():
    """F12, with no mouse and no window that has anything drawn."""
    bpy.context.preferences.view.render_display_type = 'NONE'
    shown["before"], shown["patience"] = session.statistics, 60
    press("render.render", 'INVOKE_DEFAULT')()


def figures():
    shown["patience"] -= 1
    if shown["patience"] and (session.statistics is shown["before"] or session.statistics is not shown["last"]):
        return "again"
    print("SAW figures", session.statistics is not shown["before"], session.statistics is shown["last"], flush=True)


def kept():
    slots = bpy.data.images["Render Result"].render_slots
    print("SAW snapshot", [p.name for p in FOLDER.iterdir()], slots.active_index, [s.name for s in slots][8:],
          flush=True)


STEPS = [
    scene, tab('RENDER'), press("light_meshes.preset", level='DRAFT'), tab('RENDER'),
    press("light_meshes.soften", 'INVOKE_DEFAULT'), softened, press("render.render"), rendered, tab('RENDER'),
    lambda: None, in_the_background, figures,
    press("light_meshes.keep_snapshot", directory=str(FOLDER)), kept,
    *(tab(name) for name in ('OUTPUT', 'VIEW_LAYER', 'SCENE', 'WORLD')),
    *(tab('DATA', light) for light in ('Light', 'SUN', 'SPOT', 'AREA')), tab('OBJECT', 'AREA'),
    tab('DATA', 'Camera'), tab('OBJECT', 'Camera'), tab('OBJECT', 'Cube'), tab('MATERIAL', 'Cube'),
    shader_editor('Cube'), options("NODE_LIGHT_MESHES_PT_material_shadows"),
    shader_editor('Light'), options("NODE_LIGHT_MESHES_PT_light_shadow"),
    lambda: print("END", flush=True), lambda: bpy.ops.wm.quit_blender(),
]


def go():
    try:
        if STEPS[0]() != "again":
            del STEPS[0]
    except Exception:
        traceback.print_exc()
        del STEPS[0]
    return 0.5 if STEPS else None


bpy.app.timers.register(go, first_interval=1)
