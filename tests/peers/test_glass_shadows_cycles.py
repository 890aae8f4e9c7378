"""Shadows of glass beside Cycles with its default clamp and filter: what *Shadows of Glass: Solid* gains over *Clear*.

It prints the errors that docs/limits.md tells.
"""

import bmesh
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

pytestmark = pytest.mark.slow
SIZE = 48


def body(kind, add):
    """A body of glass above the floor that only lamps and diffuse rays see."""
    shape = bmesh.new()
    if kind in ("ball", "bulb"):
        bmesh.ops.create_uvsphere(shape, u_segments=64, v_segments=32, radius=0.8)
    else:
        bmesh.ops.create_cube(shape, size=1.6)
        bmesh.ops.scale(shape, vec=(1, 1, 0.04 if kind == "pane" else 1), verts=shape.verts)
    if kind == "bulb":  # hollow, with a thin wall
        inner = bmesh.ops.create_uvsphere(shape, u_segments=64, v_segments=32, radius=0.74)["verts"]
        bmesh.ops.reverse_faces(shape, faces=list({f for v in inner for f in v.link_faces}))
    for face in shape.faces:
        face.smooth = kind in ("ball", "bulb")
    mesh = bpy.data.meshes.new(kind)
    shape.to_mesh(mesh)
    shape.free()
    ob = add(mesh, location=(0, 0, 0.9))
    ob.visible_camera = False
    material = bpy.data.materials.new("glass")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    for name, value in (("Transmission Weight", 1), ("Roughness", 0), ("IOR", 1.45)):
        shader.inputs[name].default_value = value
    mesh.materials.append(material)


@pytest.mark.parametrize(("kind", "most", "gain"), [("ball", 0.25, 0.7), ("bulb", 0.18, 0.5), ("cube", 0.2, 0.4),
                                                    ("pane", 0.3, 0.9)])
def test_solid_is_nearer_to_cycles(scene, add, add_mesh, render, kind, most, gain):
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    add_mesh("floor", [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2, 3)])
    body(kind, add)
    lamp = bpy.data.lights.new("lamp", 'AREA')
    lamp.size, lamp.energy = 1.0, 300
    add(lamp, location=(0.8, 0, 4), rotation_euler=(0, 0.2, 0))
    camera = scene.camera
    camera.data.type, camera.data.ortho_scale = 'ORTHO', 4
    camera.location, camera.rotation_euler = (-0.3, 0, 8), (0, 0, 0)
    own, cycles = scene.light_meshes, scene.cycles
    own.refraction, own.world_light, own.bounces = 'VIEW', 'SKY', 0
    ours = {}
    for own.glass_shadows in ('CLEAR', 'SOLID'):
        ours[own.glass_shadows] = render(scene)["Combined"][..., 0]
    scene.render.engine = 'CYCLES'
    cycles.device, cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = 'CPU', 256, False, False
    cycles.diffuse_bounces = 1
    theirs = render(scene)["Combined"][..., 0]

    def blurred(picture):  # against Cycles' noise
        p = np.pad(picture, 1, "edge")
        return sum(p[i:i + SIZE, j:j + SIZE] for i in range(3) for j in range(3)) / 9

    error = {which: np.sqrt(np.mean((blurred(p) - blurred(theirs)) ** 2)) / theirs.mean() for which, p in ours.items()}
    print(f"{kind}: RMSE / mean {error['CLEAR']:.3f} clear, {error['SOLID']:.3f} solid")
    assert error['SOLID'] < most
    assert error['SOLID'] < gain * error['CLEAR']
