"""Small scenes for every_property.py: one that shows shadows, and others for properties that it does not show."""

import math

import bmesh
import bpy

WIDTH, HEIGHT, VIEW = 64, 48, 4.0  # pixels, and scene units across


def stage():
    """A floor seen straight from above under a sun, with its right half in the shadow of a half plane; the world is
    black.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.engine = 'LIGHT_MESHES'
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    lens = bpy.data.cameras.new("Camera")
    lens.type, lens.ortho_scale = 'ORTHO', VIEW
    scene.camera = add(lens, location=(0, 0, 10))
    add(rectangle("Floor", (-5, -5), (5, 5)), material="Ground")
    add(rectangle("Blocker", (0, -5), (5, 5)), material="Caster", location=(0, 0, 1), visible_camera=False)
    sun = bpy.data.lights.new("Sun", 'SUN')
    sun.energy, sun.angle, sun.light_meshes.softness = math.pi, 0.5, 'SCENE'
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


# Scenes for properties that the stage does not show. Each is a change of the stage.


def nothing():
    pass


def bright_world():
    world = bpy.context.scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    next(n for n in world.node_tree.nodes if n.type == 'BACKGROUND').inputs["Color"].default_value = (.5, .5, .5, 1)


def coarse():
    bpy.context.scene.light_meshes.h = 0.3


def zooming_out():
    """The camera zooms out from frame 1, which is rendered, to frame 9."""
    scene = bpy.context.scene
    scene.light_meshes.auto_h = True
    for frame, scale in ((9, 8 * VIEW), (1, VIEW)):
        scene.camera.data.ortho_scale = scale
        scene.camera.data.keyframe_insert("ortho_scale", frame=frame)
    scene.frame_set(1)


def silhouette():
    """The edge of the floor against black, not parallel to the pixels."""
    hide("Blocker")
    bpy.data.objects["Floor"].location.x, bpy.data.objects["Floor"].rotation_euler.z = 5.5, 0.2
    bpy.context.scene.light_meshes.samples = 1


def silhouette_of_samples():
    """The same with some samples."""
    silhouette()
    bpy.context.scene.light_meshes.samples = 4


def under_a_lamp():
    """Light that differs from place to place, and shadow edges many pixels wide."""
    lamp = bpy.data.lights["Sun"]
    lamp.type, lamp.energy = 'POINT', 300
    bpy.context.scene.light_meshes.h = 0.2


def under_lamps():
    """40 lamps whose shadows come apart, in four rows."""
    bpy.data.lights["Sun"].energy = 0
    small = bpy.data.lights.new("Lamp", 'POINT')
    small.energy, small.shadow_soft_size, small.light_meshes.softness = 10, 0.1, 'SCENE'
    for n in range(40):
        add(small, location=(n // 10 - 2.5, n % 10 / 2 - 2.25, 3))


def sampled():
    own = bpy.context.scene.light_meshes
    own.shadows, own.light_samples = 'AREA_SAMPLING', 2


def glowing_sky():
    """A bright object that is visible only in mirrors."""
    hide("Blocker")
    add(rectangle("Sky", (-9, -9), (9, 9)), material="Sky", location=(0, 0, 3), visible_camera=False,
        visible_shadow=False)
    override("Sky", emission=(1, 1, 1))


def mirror():
    glowing_sky()
    override("Ground", mirror=(1, 1, 1))


def mirror_of_a_ceiling():
    """What mirrors show of a surface that a lamp lights; what gives light itself has no limit there."""
    mirror()
    override("Sky", emission=(0, 0, 0))
    lamp = bpy.data.lights.new("Lamp", 'POINT')
    lamp.energy = 1000
    add(lamp, location=(0, 0, 2))


def rough_ground():
    """A slope that the sun lights, and which rough metal shows."""
    beside_a_slope()
    own = bpy.context.scene.light_meshes
    own.bounces, own.h, own.samples = 1, 0.1, 2
    metal = bpy.data.materials.new("Metal")
    metal.use_nodes = True
    shader = metal.node_tree.nodes["Principled BSDF"]
    shader.inputs["Metallic"].default_value, shader.inputs["Roughness"].default_value = 1, 0.4
    bpy.data.objects["Floor"].data.materials[0] = metal


def oblique_highlight():
    hide("Blocker")
    bpy.data.objects["Sun"].rotation_euler.y = 0.3
    override("Ground", ks=1)


def slab():
    """An oblique slab whose near side is on the right, over a floor that glows on the right. A bent ray from above
    meets the floor farther to the left.
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
    """The slab is inside a larger body that hardly bends light, and that has the higher priority."""
    glass_slab()
    add(box("Air", (-3, -3, 0.2), (3, 3, 3)), material="Air")
    glass("Air", 1.001)
    bpy.data.materials["Air"].light_meshes.priority = 1


def pane():
    """A dark pane that stands on the floor."""
    hide("Blocker")
    add(mesh("Pane", [(0, -5, 0), (0, 5, 0), (0, 5, 2), (0, -5, 2)], [(0, 1, 2, 3)]), material="Pane")
    override("Pane", kt=(0.02, 0.02, 0.02))
    bpy.context.scene.light_meshes.h = 0.2


def lens():
    hide("Blocker")
    ball("Ball", 1.0, 24, location=(0, 0, 1.6), visible_camera=False)
    glass("Ball", 1.5)
    bpy.context.scene.light_meshes.refraction = 'FULL'


def clear_ball():
    lens()
    own = bpy.context.scene.light_meshes
    own.refraction, own.glass_shadows = 'VIEW', 'CLEAR'


def beside_a_slope():
    """A slope that the sun lights, and which lights the floor."""
    add(mesh("Slope", [(-1, -5, 0), (-1, 5, 0), (-3, 5, 2), (-3, -5, 2)], [(0, 1, 2, 3)]), material="Ground",
        visible_camera=False)


def below_a_table():
    """The edge of a table from near by: a ball of heavy glass below sends light up past it."""
    hide("Blocker", "Floor", "Sun")
    add(box("Table", (0, -1, 0.9), (1, 1, 1)), material="Ground")
    ball("Ball", 0.3, 64, location=(-1, 0, 0.8), visible_camera=False)
    glass("Ball", 2.4)
    lamp = bpy.data.lights.new("Lamp", 'POINT')
    lamp.energy, lamp.light_meshes.softness = 500, 'SCENE'
    add(lamp, location=(-1, 0, 4))
    own = bpy.context.scene.light_meshes
    own.h, own.refraction, own.caustics = 0.03, 'FULL', 'PAPER'
    bpy.context.scene.camera.location.x = 0.05
    bpy.context.scene.camera.data.ortho_scale = 0.09


def own_radius():
    own = bpy.data.lights["Sun"].light_meshes
    own.softness, own.radius = 'RADIUS', 0.05


def wide_radius():
    bpy.data.lights["Sun"].light_meshes.radius = 0.3


def sized():
    own = bpy.data.lights["Sun"].light_meshes
    own.softness, own.reference_distance = 'LIGHT_SIZE', 0.2
