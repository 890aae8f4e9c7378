"""Take screenshots of panels, of the render properties and of a lamp. Run it in a Blender with a window (see
pictures.py).
"""

import importlib.util
import subprocess
import sys
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[-1])
TABS = {"render": 'RENDER', "light": 'DATA'}


def add_on():
    folder = Path(__file__).parent.parent / "addon"
    spec = importlib.util.spec_from_file_location("light_meshes_addon", folder / "__init__.py",
                                                  submodule_search_locations=[str(folder)])
    sys.modules[spec.name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.register()


def properties():
    return next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.ui_type == 'PROPERTIES')


def properties_only():
    """Make a lamp with a size active, and show only the properties editor."""
    bpy.ops.wm.open_mainfile(filepath=str(Path(__file__).with_name("limits.blend")), load_ui=False)
    bpy.context.view_layer.objects.active = bpy.data.objects["Lamp"]
    window = bpy.context.window_manager.windows[0]
    area = max(window.screen.areas, key=lambda a: a.width * a.height)
    area.ui_type = 'PROPERTIES'
    with bpy.context.temp_override(window=window, area=area):
        bpy.ops.screen.screen_full_area(use_hide_panels=True)


def steps():
    yield properties_only
    for name, tab in TABS.items():
        yield lambda tab=tab: setattr(properties().spaces.active, "context", tab)
        yield lambda name=name: subprocess.run(["import", "-window", "root", f"PNG24:{FOLDER / name}.png"], check=True)


def run(todo=steps()):  # noqa: B008  one story
    step = next(todo, None)
    if step is None:
        bpy.ops.wm.quit_blender()
        return None
    step()
    return 2.0


add_on()
bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(run, first_interval=4.0, persistent=True)
