"""What the scenes of the contest share: textures made by script, materials, meshes, lamps, a flight, saving.

All lengths are metres, and energies those of Blender, so that Cycles and this engine render the same file. Lamps have
the softness of a new lamp: the shadow of their own shape.
"""

import sys
from math import cos, pi, sin
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from parts import add, box, clean_scene, lathe, light, mesh, principled, towards, world

__all__ = [
    "FRAMES",
    "add",
    "ball",
    "box",
    "clean_scene",
    "cloth",
    "concrete",
    "emission",
    "emitter",
    "facade",
    "flight",
    "grid",
    "image",
    "lamp",
    "lathe",
    "leaf",
    "mesh",
    "noise",
    "plaster",
    "principled",
    "save",
    "sky",
    "start",
    "textured",
    "towards",
    "tube",
    "unwrap",
    "wood",
    "world",
]

FRAMES = 20  # of every flight


# --- Textures ------------------------------------------------------------------------------------------------


def noise(size, scale, seed, octaves=4):
    """Return a (size, size) picture of smooth noise from 0 to 1, which can be put side by side without a seam."""
    random, total = np.random.default_rng(seed), np.zeros((size, size))
    for octave in range(octaves):
        cells = min(size, scale * 2**octave)
        values = random.random((cells, cells))
        at = np.arange(size) * cells / size
        low, part = at.astype(int), at % 1
        part = part * part * (3 - 2 * part)
        high = (low + 1) % cells
        rows = values[low] * (1 - part[:, None]) + values[high] * part[:, None]
        total += (rows[:, low] * (1 - part) + rows[:, high] * part) / 2**octave
    total -= total.min()
    return total / total.max()


def image(name, pixels, data=False):
    """Return an image with (h, w, 3 or 4) pixels from 0 to 1, packed into the file; `data`: not a colour."""
    height, width, channels = pixels.shape
    full = np.ones((height, width, 4), np.float32)
    full[..., :channels] = pixels
    made = bpy.data.images.new(name, width, height, alpha=channels == 4, is_data=data)
    made.pixels.foreach_set(np.clip(full, 0, 1).ravel())
    made.pack()
    return made


def tinted(value, dark, light):
    """Return colours from `dark` to `light` for values from 0 to 1."""
    return np.asarray(dark) + value[..., None] * (np.asarray(light) - np.asarray(dark))


def wood(name, dark=(0.27, 0.15, 0.08), light=(0.62, 0.42, 0.26), planks=6, size=512):
    """Return an image of planks with their grain, joints and unequal tones."""
    y, x = np.meshgrid(np.arange(size) / size, np.arange(size) / size, indexing="ij")
    plank, inside = np.floor(planks * y), (planks * y) % 1
    tone = np.random.default_rng(5).random(planks)[plank.astype(int)]
    turbulence = noise(size, 3, 11)
    grain = 0.5 + 0.5 * np.sin(2 * pi * (7 * inside + 3 * turbulence + 5 * tone))
    fine = noise(size, 64, 12, 2)
    value = 0.3 + 0.22 * grain + 0.16 * fine + 0.35 * (tone - 0.3)
    joint = (inside < 0.02) | (np.abs((x + 0.37 * plank) % 1) < 0.004)
    return image(name, tinted(np.where(joint, -0.25, value), dark, light))


def cloth(name, first, second, threads=64, stripes=0, size=512):
    """Return an image of a weave; with `stripes`, its second colour stands in stripes."""
    y, x = np.meshgrid(np.arange(size) / size, np.arange(size) / size, indexing="ij")
    weave = np.where(
        (np.floor(x * threads) + np.floor(y * threads)) % 2 == 0,
        np.sin(pi * (x * threads % 1)),
        np.sin(pi * (y * threads % 1)),
    )
    shade = 0.72 + 0.28 * weave + 0.1 * (noise(size, 8, 3) - 0.5)
    second_here = (np.floor(x * 2 * stripes) % 2 == 1) if stripes else noise(size, 5, 9) > 0.62
    return image(name, shade[..., None] * np.where(second_here[..., None], second, first))


def concrete(name, tone=(0.42, 0.41, 0.39), size=512):
    """Return an image of concrete: spots, clouds, pores."""
    value = (
        0.55 * noise(size, 4, 21) + 0.3 * noise(size, 32, 22, 3) + 0.15 * np.random.default_rng(2).random((size, size))
    )
    pores = noise(size, 96, 23, 1) > 0.93
    return image(name, np.where(pores, 0.5, 0.72 + 0.5 * (value - 0.5))[..., None] * np.asarray(tone) * 1.25)


def plaster(name, tone=(0.75, 0.72, 0.66), size=256):
    """Return an image of a painted wall that is nearly even."""
    return image(name, (0.94 + 0.12 * (noise(size, 6, 31) - 0.5))[..., None] * np.asarray(tone))


def facade(name, wall, dark, size=512, floors=4, columns=4):
    """Return an image of a house's front: bricks, and rows of windows with sills and frames."""
    y, x = np.meshgrid(np.arange(size) / size, np.arange(size) / size, indexing="ij")
    row = np.floor(y * 64)
    joint = ((y * 64) % 1 < 0.14) | ((x * 32 + 0.5 * (row % 2)) % 1 < 0.07)
    tone = np.random.default_rng(8).random((64, 33))[row.astype(int), np.floor(x * 32 + 0.5 * (row % 2)).astype(int)]
    pixels = (0.75 + 0.35 * tone)[..., None] * np.asarray(wall)
    pixels = np.where(joint[..., None], 0.55 * np.asarray(wall) + 0.18, pixels)
    u, v = (x * columns) % 1, (y * floors) % 1
    frame = (np.abs(u - 0.5) < 0.27) & (v > 0.2) & (v < 0.85)
    pane = (np.abs(u - 0.5) < 0.23) & (v > 0.24) & (v < 0.81) & (np.abs(u - 0.5) > 0.015) & (np.abs(v - 0.6) > 0.012)
    sill = (np.abs(u - 0.5) < 0.3) & (v > 0.155) & (v <= 0.2)
    pixels = np.where((frame | sill)[..., None], (0.74, 0.72, 0.68), pixels)
    return image(name, np.where(pane[..., None], dark, pixels))


def leaf(name, size=128):
    """Return an image with alpha: a twig with seven leaves."""
    y, x = np.meshgrid(np.arange(size) / size, np.arange(size) / size, indexing="ij")
    alpha, tone = np.abs(x - 0.5) < 0.008 + 0.008 * (1 - y), np.zeros((size, size))
    alpha &= y < 0.8
    for n in range(7):
        turn, root = (1 if n % 2 else -1) * (0.9 - 0.06 * n) * (n < 6), 0.08 + 0.1 * n
        along = (x - 0.5) * sin(turn) + (y - root) * cos(turn)
        across = np.abs((x - 0.5) * cos(turn) - (y - root) * sin(turn))
        length = 0.36 - 0.015 * n
        part = np.clip(along / length, 0, 1)
        inside = (along > 0) & (along < length) & (across < 0.42 * length * np.sin(pi * part**0.8) * 0.75)
        tone = np.where(inside, 0.5 + 0.35 * part - 0.25 * (across < 0.006), tone)
        alpha |= inside
    pixels = np.empty((size, size, 4))
    pixels[..., :3] = tinted(np.clip(tone, 0, 1), (0.07, 0.14, 0.03), (0.26, 0.44, 0.09))
    pixels[..., 3] = alpha
    return image(name, pixels)


def sky(strength, zenith=(0.16, 0.33, 0.75), horizon=(0.75, 0.82, 0.9), ground=(0.22, 0.2, 0.17), clouds=0.5, size=256):
    """Light the scene with an environment picture: a blue sky with clouds, and no sun: that is a lamp."""
    height = np.linspace(-pi / 2, pi / 2, size)[:, None]
    up = np.clip(np.sin(height), 0, 1) ** 0.5
    pixels = tinted(np.broadcast_to(up, (size, 2 * size)), horizon, zenith)
    banks = np.concatenate([noise(size, 3, 41, 5)] * 2, 1)
    cover = np.clip((banks - 1 + clouds) * 4, 0, 1) * np.clip(3 * np.sin(height), 0, 1)
    pixels = pixels * (1 - cover[..., None]) + cover[..., None] * np.asarray((0.95, 0.95, 0.96))
    pixels = np.where((height < 0)[..., None], np.asarray(ground), pixels)
    made = bpy.data.worlds.new("Sky")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    picture = nodes.new('ShaderNodeTexEnvironment')
    picture.image = image("Sky", pixels)
    links.new(picture.outputs["Color"], nodes["Background"].inputs["Color"])
    nodes["Background"].inputs["Strength"].default_value = strength
    bpy.context.scene.world = made


# --- Materials -----------------------------------------------------------------------------------------------


def textured(name, picture, alpha=False, bump=0.0, **inputs):
    """Return a Principled material whose base colour is a picture by UV; `bump` is the height in metres of its grey."""
    made = principled(name, **inputs)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    texture = nodes.new('ShaderNodeTexImage')
    texture.image = picture
    links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    if alpha:
        links.new(texture.outputs["Alpha"], nodes["Principled BSDF"].inputs["Alpha"])
    if bump:
        height = nodes.new('ShaderNodeBump')
        height.inputs["Distance"].default_value = bump
        links.new(texture.outputs["Color"], height.inputs["Height"])
        links.new(height.outputs["Normal"], nodes["Principled BSDF"].inputs["Normal"])
    return made


def emission(name, color, strength):
    """Return a material that shines: for what is seen of a lamp."""
    made = principled(name, (0, 0, 0), Emission_Color=(*color, 1), Emission_Strength=strength, Roughness=1.0)
    if hasattr(made, "cycles"):
        made.cycles.emission_sampling = 'NONE'
    return made


# --- Meshes --------------------------------------------------------------------------------------------------


def unwrap(data, size=1.0, middle=(0.0, 0.0)):
    """Give a mesh UVs: each face is seen along its main axis, and the picture repeats after `size` metres. `middle`:
    the UV of the origin.
    """
    corners = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", corners)
    points = np.empty(3 * len(data.vertices), np.float32)
    data.vertices.foreach_get("co", points)
    normals = np.empty(3 * len(data.polygons), np.float32)
    data.polygons.foreach_get("normal", normals)
    sides = np.empty(len(data.polygons), np.int32)
    data.polygons.foreach_get("loop_total", sides)
    main = np.repeat(np.abs(normals.reshape(-1, 3)).argmax(1), sides)
    at = points.reshape(-1, 3)[corners] / size
    u = middle[0] + np.where(main == 0, at[:, 1], at[:, 0])
    v = middle[1] + np.where(main == 2, at[:, 1], at[:, 2])
    layer = data.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", np.stack([u, v], 1).astype(np.float32).ravel())
    return data


def grid(name, xs, ys, height, material=None, smooth=True):
    """Return a mesh of the function height(x, y) → z over a grid, with UVs from 0 to 1."""
    x, y = np.meshgrid(xs, ys)
    z = np.broadcast_to(height(x, y), x.shape)
    wide = len(xs)
    corner = (np.arange(len(ys) - 1)[:, None] * wide + np.arange(wide - 1)).ravel()
    faces = np.stack([corner, corner + 1, corner + wide + 1, corner + wide], 1)
    made = mesh(name, np.stack([x, y, z], -1).reshape(-1, 3).tolist(), faces.tolist(), material, smooth)
    u, v = (x - xs[0]) / (xs[-1] - xs[0]), (y - ys[0]) / (ys[-1] - ys[0])
    made.uv_layers.new(name="UVMap").data.foreach_set(
        "uv", np.stack([u, v], -1).reshape(-1, 2)[faces.ravel()].astype(np.float32).ravel()
    )
    return made


def ball(name, radius, material=None, sides=48, squash=1.0):
    """Return a smooth ball around the origin."""
    rings = sides // 2
    profile = [(radius * sin(pi * k / rings), -squash * radius * cos(pi * k / rings)) for k in range(1, rings)]
    return lathe(name, [(0, -squash * radius), *profile, (0, squash * radius)], sides, material)


def tube(name, path, radius, material=None, sides=10):
    """Return a mesh of a tube along points, with ends."""
    points, vertices, faces = np.asarray(path, float), [], []
    for k, point in enumerate(points):
        way = points[min(k + 1, len(points) - 1)] - points[max(k - 1, 0)]
        way /= np.linalg.norm(way)
        side = np.cross(way, (0, 0, 1) if abs(way[2]) < 0.9 else (1, 0, 0))
        side /= np.linalg.norm(side)
        other = np.cross(way, side)
        vertices += [
            tuple(point + radius * (cos(a) * side + sin(a) * other)) for a in 2 * pi * np.arange(sides) / sides
        ]
    for k in range(len(points) - 1):
        faces += [
            (k * sides + s, k * sides + (s + 1) % sides, (k + 1) * sides + (s + 1) % sides, (k + 1) * sides + s)
            for s in range(sides)
        ]
    faces += [tuple(range(sides))[::-1], tuple(range(len(vertices) - sides, len(vertices)))]
    return mesh(name, vertices, faces, material, smooth=True)


# --- Lamps, camera, file -------------------------------------------------------------------------------------


def lamp(name, kind, energy, location, target=None, color=(1, 1, 1), **values):
    """Add a lamp as Blender makes a new one: the shadow of its own shape. Spots, areas and suns look at `target`."""
    made = light(name, kind, energy, location, target, color, **values)
    made.data.light_meshes.softness = 'SIZE'
    return made


def emitter(name, data, location=(0, 0, 0), **values):
    """Add the visible part of a lamp. All light comes from the lamp inside: this part casts no shadow of it, lights
    nothing, and has no mirror images, which the lamp has.
    """
    made = add(name, data, location, **values)
    made.visible_shadow = made.visible_diffuse = made.visible_glossy = False
    return made


def flight(start, end, target_start, target_end, lens):
    """Add a camera (`lens` in mm) that goes from `start` to `end` in FRAMES frames, and looks from target to
    target.
    """
    scene, data = bpy.context.scene, bpy.data.cameras.new("Camera")
    data.lens = lens
    made = add("Camera", data)
    scene.camera = made
    scene.frame_start, scene.frame_end = 1, FRAMES
    for n in range(FRAMES):
        part = n / (FRAMES - 1)
        where = tuple(np.asarray(start) * (1 - part) + np.asarray(end) * part)
        made.location = where
        made.rotation_euler = towards(
            where, tuple(np.asarray(target_start) * (1 - part) + np.asarray(target_end) * part)
        )
        made.keyframe_insert("location", frame=n + 1)
        made.keyframe_insert("rotation_euler", frame=n + 1)
    scene.frame_set(1)


def start(exposure=0.0, transform='AgX'):
    """Make an empty scene at 1920×1080 with a view transform and Cycles' bounces of an ordinary file."""
    scene = clean_scene(1920, 1080, world_light='SKY', bounces=1, glass_shadows='SOLID')  # as in a new file
    scene.view_settings.view_transform, scene.view_settings.exposure = transform, exposure
    return scene


def save(name, folder):
    """Write FOLDER/NAME.blend."""
    bpy.context.scene.render.filepath = "//"
    path = Path(folder) / f"{name}.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()), compress=True)
    print(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB")
