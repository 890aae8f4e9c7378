"""A row for every property of the add-on: what it changes in a picture, and a scene that shows the change.

pytest runs the rows (test_addon_every_property.py). Without pytest, any Blender can run this file as a script.
"""

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))  # Blender does not look beside a script

from property_scenes import (
    HEIGHT,
    WIDTH,
    below_a_table,
    beside_a_slope,
    bright_world,
    clear_ball,
    coarse,
    glass_slab,
    glowing_sky,
    lens,
    mirror,
    mirror_of_a_ceiling,
    nothing,
    oblique_highlight,
    own_radius,
    pane,
    rough_ground,
    sampled,
    silhouette,
    silhouette_of_samples,
    sized,
    slab,
    slab_in_air,
    stage,
    under_a_lamp,
    under_lamps,
    wide_radius,
    zooming_out,
)

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


def fewer_levels(before, after):
    return more_levels(after, before)


def less_noisy(before, after):
    return np.abs(np.diff(after, axis=0)).mean() < 0.5 * np.abs(np.diff(before, axis=0)).mean()


def hardly_changed(before, after):
    difference = np.abs(after.astype(float) - before)
    return 0 < difference.max() <= 1 / 64 and (difference**2).mean() ** 0.5 <= 1 / 512


def near(before, after):
    difference = np.abs(after.astype(float) - before)
    return difference.max() > 0 and (difference**2).mean() ** 0.5 <= 1 / 16


def dimmer_spot(before, after):
    return before.max() > 1.2 * after.max()


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
    Row("scene", "measure_frame", 9, wider, zooming_out),
    Row("scene", "h", 0.2, wider),
    Row("scene", "kI", 6.0, wider),
    Row("scene", "weights", 'UNIFORM', wider, coarse),
    Row("scene", "shadow_rate", 4, hardly_changed, under_a_lamp),
    Row("scene", "light_threshold", 0.2, near, under_lamps),
    Row("scene", "refraction", 'NONE', brighter, glass_slab),
    Row("scene", "glass_shadows", 'SOLID', darker, clear_ball),
    Row("scene", "glass", 'PAPER', darker, pane),
    Row("scene", "caustics", 'PAPER', dimmer_spot, lens),
    Row("scene", "leak_free", True, darker, below_a_table),
    Row("scene", "samples", 32, more_levels, silhouette),
    Row("scene", "share_samples", False, fewer_levels, silhouette_of_samples),
    Row("scene", "light_samples", 256, less_noisy, sampled),
    Row("scene", "max_depth", 0, darker, mirror),
    Row("scene", "fast_reflections", False, near, rough_ground),
    Row("scene", "clamp_indirect", 0.1, darker, mirror_of_a_ceiling),
    Row("scene", "ambient", 0.0, darker, bright_world),
    Row("scene", "world_light", 'SKY', darker, bright_world),
    Row("scene", "bounces", 1, brighter, beside_a_slope),
    Row("light", "soft_shadows", False, narrower, thing="Sun"),
    Row("light", "softness", 'RADIUS', wider, wide_radius, "Sun"),
    Row("light", "radius", 0.3, wider, own_radius, "Sun"),
    Row("light", "reference_distance", 1.0, wider, sized, "Sun"),
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
        # What chooses passes changes no pixel of Combined; their own tests render them.
        there |= {f"{owner}.{p.identifier}" for p in group.properties
                  if p.identifier not in {"rna_type", "name"} and "pass" not in p.identifier and not p.is_hidden}
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
