"""A row for every property of the add-on: what it does to a picture, in a scene that shows it.

pytest runs the rows (test_addon_every_property.py), and as a script any Blender does, without pytest.
"""

import math
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import bmesh
import bpy
import numpy as np

WIDTH, HEIGHT, VIEW = 64, 48, 4.0  # pixels, and scene units across


def stage():
    """A floor seen straight from above, its right half in the shadow of a half plane, under a sun; no world."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.engine = 'LIGHT_MESHES'
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    lens = bpy.data.cameras.new("Camera")
    lens.type, lens.ortho_scale = 'ORTHO', VIEW
    scene.camera = add(lens, location=(0, 0, 10))
    add(rectangle("Floor", (-5, -5), (5, 5)), material="Ground")
    add(rectangle("Blocker", (0, -5), (5, 5)), material="Caster", location=(0, 0, 1), visible_camera=False)
    sun = bpy.data.lights.new("Sun", 'SUN')
    sun.energy, sun.angle = math.pi, 0.5
    add(sun, location=(0, 0, 5))
    own = scene.light_meshes
    own.auto_h, own.h, own.kI = False, 0.05, 3


def add(data, material="", **properties):
    ob = bpy.data.objects.new(data.name, data)
    bpy.context.scene.collection.objects.link(ob)
    if material:
        data.materials.append(bpy.data.materials.get(material) or diffuse(material))
    for name, value in properties.items():
        setattr(ob, name, value)
    return ob


def diffuse(name):
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new('ShaderNodeBsdfDiffuse')
    shader.inputs["Color"].default_value = (0.8, 0.8, 0.8, 1)
    tree.links.new(shader.outputs[0], tree.nodes.new('ShaderNodeOutputMaterial').inputs["Surface"])
    return material


def rectangle(name, low, high):
    (x0, y0), (x1, y1) = low, high
    return mesh(name, [(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)], [(0, 1, 2, 3)])


def box(name, low, high):
    corners = [tuple((low, high)[i >> k & 1][k] for k in range(3)) for i in range(8)]
    return mesh(name, corners, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])


def ball(name, radius, around, **properties):
    shape, data = bmesh.new(), bpy.data.meshes.new(name)
    bmesh.ops.create_uvsphere(shape, u_segments=around, v_segments=around // 2, radius=radius)
    shape.to_mesh(data)
    shape.free()
    data.polygons.foreach_set("use_smooth", [True] * len(data.polygons))
    add(data, material=name, **properties)


def mesh(name, vertices, faces):
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    return data


def override(material, **values):
    own = bpy.data.materials[material].light_meshes
    for name, value in values.items():
        setattr(own, f"override_{name}", True)
        setattr(own, name, value)


def glass(material, ior=1.0):
    override(material, kd=0, ka=0, ks=0, kt=(1, 1, 1), ior=ior)


def hide(*names):
    for name in names:
        bpy.data.objects[name].hide_render = True


# Scenes that show what the stage does not. Each changes the stage.


def nothing():
    pass


def bright_world():
    world = bpy.context.scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    next(n for n in world.node_tree.nodes if n.type == 'BACKGROUND').inputs["Color"].default_value = (.5, .5, .5, 1)


def coarse():
    bpy.context.scene.light_meshes.h = 0.3


def silhouette():
    """The floor's edge, which is not along the pixels, against black."""
    hide("Blocker")
    bpy.data.objects["Floor"].location.x, bpy.data.objects["Floor"].rotation_euler.z = 5.5, 0.2
    bpy.context.scene.light_meshes.samples = 1


def sampled():
    own = bpy.context.scene.light_meshes
    own.shadows, own.light_samples = 'AREA_SAMPLING', 2


def glowing_sky():
    """Something bright that is seen in mirrors only."""
    hide("Blocker")
    add(rectangle("Sky", (-9, -9), (9, 9)), material="Sky", location=(0, 0, 3), visible_camera=False,
        visible_shadow=False)
    override("Sky", emission=(1, 1, 1))


def mirror():
    glowing_sky()
    override("Ground", mirror=(1, 1, 1))


def oblique_highlight():
    hide("Blocker")
    bpy.data.objects["Sun"].rotation_euler.y = 0.3
    override("Ground", ks=1)


def slab():
    """An oblique slab, its near side to the right, over a floor that glows on the right: a bent ray from above meets
    the floor farther to the left.
    """
    hide("Blocker", "Sun", "Floor")
    add(rectangle("Glow", (0, -5), (5, 5)), material="Glow")
    override("Glow", emission=(1, 1, 1))
    add(box("Slab", (-1.2, -1, -0.5), (1.2, 1, 0.5)), material="Slab", location=(0, 0, 1.5),
        rotation_euler=(0, 0.6, 0))
    glass("Slab")


def glass_slab():
    slab()
    glass("Slab", 1.5)


def slab_in_air():
    """The slab lies in a larger body that bends next to nothing, and that is there instead."""
    glass_slab()
    add(box("Air", (-3, -3, 0.2), (3, 3, 3)), material="Air")
    glass("Air", 1.001)
    bpy.data.materials["Air"].light_meshes.priority = 1


def pane():
    """A dark pane, which stands on the floor."""
    hide("Blocker")
    add(mesh("Pane", [(0, -5, 0), (0, 5, 0), (0, 5, 2), (0, -5, 2)], [(0, 1, 2, 3)]), material="Pane")
    override("Pane", kt=(0.02, 0.02, 0.02))
    bpy.context.scene.light_meshes.h = 0.2


def lens():
    hide("Blocker")
    ball("Ball", 1.0, 24, location=(0, 0, 1.6), visible_camera=False)
    glass("Ball", 1.5)
    bpy.context.scene.light_meshes.refraction = 'FULL'


def below_a_table():
    """A table's edge from near by: a ball of heavy glass below sends light up past it."""
    hide("Blocker", "Floor", "Sun")
    add(box("Table", (0, -1, 0.9), (1, 1, 1)), material="Ground")
    ball("Ball", 0.3, 64, location=(-1, 0, 0.8), visible_camera=False)
    glass("Ball", 2.4)
    lamp = bpy.data.lights.new("Lamp", 'POINT')
    lamp.energy = 500
    add(lamp, location=(-1, 0, 4))
    own = bpy.context.scene.light_meshes
    own.h, own.refraction = 0.03, 'FULL'
    bpy.context.scene.camera.location.x = 0.05
    bpy.context.scene.camera.data.ortho_scale = 0.09


def own_radius():
    own = bpy.data.lights["Sun"].light_meshes
    own.softness, own.radius = 'RADIUS', 0.05


def wide_radius():
    bpy.data.lights["Sun"].light_meshes.radius = 0.6


def sized():
    own = bpy.data.lights["Sun"].light_meshes
    own.softness, own.reference_distance = 'LIGHT_SIZE', 0.2


# What is seen of a picture (rows from the bottom up): before → after.


def brighter(before, after):
    return after.mean() > 1.02 * before.mean() + 1e-3


def darker(before, after):
    return brighter(after, before)


def wider(before, after):
    return edge(after) > 1.15 * edge(before)


def narrower(before, after):
    return wider(after, before)


def edge(picture):
    """Pixels across the shadow's edge, which lies along y, with grey counting most."""
    share = np.clip(picture[..., 0].mean(0) / picture[:, :4, 0].mean(), 0, 1)
    return (4 * share * (1 - share)).sum()


def more_levels(before, after):
    return len(np.unique(after.round(3))) > 2 * len(np.unique(before.round(3)))


def less_noisy(before, after):
    return np.abs(np.diff(after, axis=0)).mean() < 0.5 * np.abs(np.diff(before, axis=0)).mean()


def brighter_spot(before, after):
    return after.max() > 1.2 * before.max()


class Row(NamedTuple):
    owner: str  # what has the property
    name: str
    value: Any  # which it changes to
    seen: Callable  # (before, after) → bool
    prepare: Callable = nothing
    thing: str = ""  # the owner's name

    @property
    def id(self):
        return f"{self.owner}.{self.name}"


GREY = (0.2, 0.2, 0.2)
_PARAMETERS = [  # of a material, each with its override
    ("ka", 0.2, darker, bright_world, "Ground"),
    ("kd", 0.3, darker, nothing, "Ground"),
    ("Od", GREY, darker, nothing, "Ground"),
    ("ks", 1.0, brighter, nothing, "Ground"),
    ("Os", (0.0, 0.0, 0.0), darker, oblique_highlight, "Ground"),
    ("nShiny", 500.0, darker, oblique_highlight, "Ground"),
    ("mirror", (0.8, 0.8, 0.8), brighter, glowing_sky, "Ground"),
    ("emission", (1.0, 1.0, 1.0), brighter, nothing, "Ground"),
    ("kt", (0.9, 0.9, 0.9), brighter, nothing, "Caster"),
    ("ior", 1.5, darker, slab, "Slab"),
    ("fresnel", True, darker, glass_slab, "Slab"),
    ("alpha", 0.0, darker, nothing, "Ground"),
]
ROWS = [
    Row("scene", "mode", 'LOCAL', brighter),
    Row("scene", "shadows", 'SHARP', narrower),
    Row("scene", "auto_h", True, narrower, coarse),
    Row("scene", "h", 0.2, wider),
    Row("scene", "kI", 6.0, wider),
    Row("scene", "weights", 'SMOOTH', narrower, coarse),
    Row("scene", "refraction", 'NONE', brighter, glass_slab),
    Row("scene", "glass", 'PAPER', darker, pane),
    Row("scene", "caustics", 'FOCUS', brighter_spot, lens),
    Row("scene", "leak_free", True, darker, below_a_table),
    Row("scene", "samples", 32, more_levels, silhouette),
    Row("scene", "light_samples", 256, less_noisy, sampled),
    Row("scene", "max_depth", 0, darker, mirror),
    Row("scene", "ambient", 0.0, darker, bright_world),
    Row("light", "soft_shadows", False, narrower, thing="Sun"),
    Row("light", "softness", 'RADIUS', wider, wide_radius, "Sun"),
    Row("light", "radius", 0.6, wider, own_radius, "Sun"),
    Row("light", "reference_distance", 2.0, wider, sized, "Sun"),
    Row("object", "cast_soft_shadows", False, narrower, thing="Blocker"),
    Row("object", "receive_soft_shadows", False, narrower, thing="Floor"),
    Row("material", "cast_soft_shadows", False, narrower, thing="Caster"),
    Row("material", "receive_soft_shadows", False, narrower, thing="Ground"),
    Row("material", "priority", 2, darker, slab_in_air, "Slab"),
    *(Row("material", name, value, seen, prepare, thing) for name, value, seen, prepare, thing in _PARAMETERS),
    *(Row("material", f"override_{name}", True, seen, prepare, thing)
      for name, value, seen, prepare, thing in _PARAMETERS),
]
_VALUES = {name: value for name, value, *_ in _PARAMETERS}


def owner_of(row):
    """The data-block that has the property."""
    if row.owner == "scene":
        return bpy.context.scene
    return {"light": bpy.data.lights, "object": bpy.data.objects, "material": bpy.data.materials}[row.owner][row.thing]


def picture():
    """(h, w, 3), rows from the bottom up, scene-linear."""
    scene = bpy.context.scene
    handle, path = tempfile.mkstemp(".exr")
    os.close(handle)
    path = Path(path)
    scene.render.image_settings.file_format = 'OPEN_EXR'
    scene.render.image_settings.color_depth = '32'
    scene.render.filepath = str(path)
    try:
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(str(path))
        pixels = np.empty(WIDTH * HEIGHT * image.channels, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    finally:
        path.unlink()
    return pixels.reshape(HEIGHT, WIDTH, -1)[..., :3]


def same(a, b):
    return np.allclose(a, b) if not isinstance(b, str) else a == b


def run(row):
    """Change the property of `row`; what is wrong with what it does, or nothing."""
    stage()
    row.prepare()
    block = owner_of(row)
    own = block.light_meshes
    parameter = row.name.removeprefix("override_")
    if row.name in _VALUES:
        setattr(own, f"override_{row.name}", True)
    elif parameter in _VALUES:
        setattr(own, f"override_{parameter}", False)
        setattr(own, parameter, _VALUES[parameter])
    if same(getattr(own, row.name), row.value):
        return "has the value before it is set"
    before = picture()
    setattr(own, row.name, row.value)
    evaluated = block.evaluated_get(bpy.context.evaluated_depsgraph_get())
    if not same(getattr(evaluated.light_meshes, row.name), row.value):
        return "does not reach evaluated data"
    after = picture()
    if not row.seen(before, after):
        return (f"is not {row.seen.__name__}: mean {before.mean():.4f} → {after.mean():.4f}, "
                f"edge {edge(before):.3f} → {edge(after):.3f}")
    return ""


def saved_and_loaded(path):
    """Set all properties, save and load; the ids of those that do not come back."""
    stage()
    glass_slab()
    for row in ROWS:
        setattr(owner_of(row).light_meshes, row.name, row.value)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert "Floor" not in bpy.data.objects
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return [row.id for row in ROWS if not same(getattr(owner_of(row).light_meshes, row.name), row.value)]


def missing():
    """Properties without a row, and rows without a property."""
    stage()
    have = {row.id for row in ROWS}
    there = set()
    for owner, kind in (("scene", bpy.types.Scene), ("light", bpy.types.Light), ("object", bpy.types.Object),
                        ("material", bpy.types.Material)):
        group = kind.bl_rna.properties["light_meshes"].fixed_type
        there |= {f"{owner}.{p.identifier}" for p in group.properties if p.identifier not in {"rna_type", "name"}}
    return sorted(have ^ there)


def main(path):
    bad = [f"{name} has no row, or no property" for name in missing()]
    bad += [f"{name} does not survive save and load" for name in saved_and_loaded(path)]
    bad += [f"{row.id} {wrong}" for row in ROWS if (wrong := run(row))]
    for sentence in bad:
        print("BAD", sentence, flush=True)
    print("CHECKED", len(ROWS), "of", bpy.app.version_string, flush=True)


if __name__ == "__main__":
    if not hasattr(bpy.types.Scene, "light_meshes"):  # in a real Blender it is enabled
        import light_meshes_addon

        light_meshes_addon.register()
    if not bpy.app.background:  # Blender crashes when it is told to quit while it still starts
        bpy.app.timers.register(bpy.ops.wm.quit_blender, first_interval=1, persistent=True)
    main(sys.argv[-1])
    if not bpy.app.binary_path:
        light_meshes_addon.unregister()
        from light_meshes_addon.headless import leave

        leave(0)
