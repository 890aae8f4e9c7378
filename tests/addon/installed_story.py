"""Enable, use and remove the add-on of a zip; run it in a Blender or bpy where the zip is installed but not enabled.

    … installed_story.py SCENE.blend NEW.zip PICTURE.png
It prints lines of a word and JSON.
"""

import gc
import json
import os
import sys
import threading
import weakref
from pathlib import Path

import addon_utils
import bpy

NAME = "bl_ext.user_default.light_meshes"
BLEND, NEW, PICTURE = sys.argv[-3:]


def say(word, what):
    print(f"\n{word} {json.dumps(what)}", flush=True)


def state():
    """All that an add-on can leave in a running Blender."""
    return {
        "classes": sorted(dir(bpy.types)),
        "properties": {name: sorted(getattr(bpy.types, name).bl_rna.properties.keys())
                       for name in ("Scene", "ViewLayer", "Light", "Object", "Material", "World", "Camera", "Mesh",
                                    "WindowManager")},
        "panels": {p.__name__: sorted(getattr(p, "COMPAT_ENGINES", ())) for p in bpy.types.Panel.__subclasses__()
                   if p.is_registered},
        "menus": {name: len(getattr(getattr(bpy.types, name).draw, "_draw_funcs", ()))
                  for name in dir(bpy.types) if "_MT_" in name and hasattr(getattr(bpy.types, name), "draw")},
        "handlers": {name: [repr(f) for f in functions] for name, functions in vars_of(bpy.app.handlers)},
        "threads": sorted(t.name for t in threading.enumerate()),
        "children": children(),
        "files": files(),
        "path": list(sys.path),
    }


def vars_of(handlers):
    return [(name, getattr(handlers, name)) for name in dir(handlers) if isinstance(getattr(handlers, name), list)]


def children():
    return [pid for task in Path("/proc/self/task").iterdir() for pid in (task / "children").read_text().split()]


def files():
    """What is there of ours: Blender keeps lists of its own."""
    roots = [Path(os.environ["BLENDER_USER_RESOURCES"]), Path(os.environ["TMPDIR"])]
    return sorted(str(p) for root in roots for p in root.rglob("*") if not p.is_dir() and ".cache" not in p.parts)


def difference(before, after):
    """What is not as it was, by kind."""
    found = {}
    for kind, was in before.items():
        now = after[kind]
        if isinstance(was, dict):
            found |= {f"{kind}: {key}": [was.get(key), now.get(key)] for key in {*was, *now}
                      if was.get(key) != now.get(key)}
        elif isinstance(was, list):
            found |= {kind: [sorted({*was} - {*now}), sorted({*now} - {*was})]} if {*was} != {*now} else {}
        elif was != now:
            found[kind] = [was, now]
    return found


def render():
    scene = bpy.context.scene
    scene.render.engine = 'LIGHT_MESHES'
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
    scene.render.filepath = PICTURE
    result = bpy.ops.render.render(write_still=True)
    return [sorted(result), len(children())]


bare = state()
addon_utils.enable(NAME, default_set=True)
bpy.ops.wm.open_mainfile(filepath=BLEND)
own = bpy.context.scene.light_meshes
own.kI, own.shadows, own.weights = 2.5, 'SHARP', 'UNIFORM'
say("RENDER", render())
bpy.ops.preferences.addon_disable(module=NAME)
say("DISABLED", difference(bare, state()))

bpy.ops.preferences.addon_enable(module=NAME)
say("RENDER", render())
repos = [repo.module for repo in bpy.context.preferences.extensions.repos if repo.enabled]
bpy.ops.extensions.package_install_files(filepath=NEW, repo="user_default", enable_on_install=True)
scene = bpy.context.scene
own = scene.light_meshes
say("UPGRADED", [scene.render.engine, own.kI, own.shadows, own.weights, children()])

say("VERSIONS", [addon_utils.module_bl_info(sys.modules[NAME])["version"],
                 [p.name for path in sys.path for p in Path(path).glob("light_meshes-*.dist-info")]])

# Uninstalled while a new engine starts.
session = sys.modules[NAME + ".session"]
engine = session.current()
while not engine.folder:
    engine.poll(0.1)
# Anything that still calls into a module holds all of it.
ours = {f"{name}.{key}": weakref.ref(value) for name, module in sys.modules.items() if name.startswith(NAME)
        for key, value in vars(module).items()
        if getattr(value, "__module__", "") == name and not isinstance(value, tuple)}
bpy.ops.extensions.package_uninstall(repo_index=repos.index("user_default"), pkg_id="light_meshes")
say("UNINSTALLED", difference(bare, state()))
say("MODULES", [name for name in sys.modules if name.startswith(NAME)])
del session, engine, own, scene
gc.collect()
say("ALIVE", sorted(name for name, one in ours.items() if one()))
