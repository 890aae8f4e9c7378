"""Successive snapshots of an edited scene equal an export from scratch, and only changes are read again."""

import json
import random

import bmesh
import bpy
import light_meshes.scene.snapshot
import numpy as np
import pytest
from light_meshes_addon.export import mesh as mesh_module
from light_meshes_addon.export.camera import frame
from light_meshes_addon.export.scenes import Scenes


class Size:
    """What `frame` wants to know of an engine."""

    camera_override = None
    resolution_x, resolution_y = 64, 48


class Watched:
    """Scenes that are told of updates as a viewport's are, and counts of what was read."""

    def __init__(self, folder, monkeypatch):
        self.folder, self.read = folder, 0
        self.scenes = Scenes(folder)
        self._original = mesh_module._corners
        monkeypatch.setattr(mesh_module, "_corners", self._count)
        bpy.app.handlers.depsgraph_update_post.append(self._note)
        bpy.app.handlers.frame_change_post.append(self._note)

    def _count(self, mesh):
        self.read += 1
        return self._original(mesh)

    def _note(self, scene, depsgraph):
        self.scenes.note(depsgraph)

    def close(self):
        bpy.app.handlers.depsgraph_update_post.remove(self._note)
        bpy.app.handlers.frame_change_post.remove(self._note)
        self.scenes.close()

    def export(self, seconds=1e9):
        """The scene file, and how many slices it took."""
        bpy.context.view_layer.update()
        depsgraph = bpy.context.evaluated_depsgraph_get()
        path = advance(self.scenes, depsgraph, seconds)
        while not self.scenes.written():
            pass
        return path


def advance(scenes, depsgraph, seconds=1e9):
    for _ in range(100_000):
        path = scenes.advance(depsgraph, seconds,
                              lambda report: frame(Size, depsgraph.scene_eval, depsgraph, report), lambda ob: True)
        if path:
            return path
    pytest.fail("the export does not end")


@pytest.fixture
def watched(scene, tmp_path, monkeypatch):
    watched = Watched(tmp_path / "scenes", monkeypatch)
    watched.folder.mkdir()
    yield watched
    watched.close()


def content(path):
    """All that a picture depends on, whatever the order of meshes, materials and objects."""
    scene = light_meshes.scene.snapshot.read(path)
    g = scene.geometry
    instances = []
    for mesh, ob, matrix in zip(g.instance_mesh, g.instance_object, g.instance_matrix, strict=True):
        v0, nv, t0, nt = g.meshes[mesh]
        part = slice(t0, t0 + nt)
        materials = [repr(scene.materials[m]) for m in g.triangle_materials[part]]
        images = [m.image >= 0 or m.alpha_image >= 0 for m in (scene.materials[i] for i in g.triangle_materials[part])]
        uvs = g.uvs[part][images].tobytes() if any(images) else b""
        instances.append((repr(scene.objects[ob]), matrix.tobytes(), g.vertices[v0:v0 + nv].tobytes(),
                          g.triangles[part].tobytes(), g.corner_normals[part].tobytes(), materials, uvs))
    used = {m.image for m in scene.materials} | {m.alpha_image for m in scene.materials}
    images = sorted(repr(i) for n, i in enumerate(scene.images) if n in used)
    return {"instances": sorted(instances), "images": len(images), "lights": scene.lights, "world": scene.world_color,
            "settings": scene.settings, "camera": repr(scene.camera)}


@pytest.fixture
def check(watched, tmp_path):
    """() → compares the next snapshot with a fresh one; how many meshes were read for it."""
    count = 0

    def run(seconds=1e9):
        nonlocal count
        count += 1
        watched.read = 0
        path = watched.export(seconds)
        read = watched.read
        fresh = Scenes(tmp_path / f"fresh-{count}")
        (tmp_path / f"fresh-{count}").mkdir()
        depsgraph = bpy.context.evaluated_depsgraph_get()
        fresh.note(depsgraph)
        other = advance(fresh, depsgraph)
        while not fresh.written():
            pass
        a, b = content(path), content(other)
        for key in a:
            assert a[key] == b[key], key
        watched.scenes.only(path)
        return read
    return run


def ball(add, name, subdivisions=2, **properties):
    mesh = bpy.data.meshes.new(name)
    shape = bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=subdivisions, radius=1)
    shape.to_mesh(mesh)
    shape.free()
    return add(mesh, **properties)


def test_only_what_changed_is_read(scene, add, add_plane, add_light, diffuse, watched, check):
    a, b = add_plane(name="A"), ball(add, "B")
    light = add_light('SUN')
    red = diffuse(name="Red")
    a.data.materials.append(red)
    assert check() == 2
    first = watched.export()
    assert watched.export() == first  # nothing changed: no new snapshot
    a.location.x = 2
    assert check() == 0
    light.data.energy = 7
    assert check() == 0
    red.node_tree.nodes["Diffuse BSDF"].inputs["Color"].default_value = (1, 0, 0, 1)
    assert check() == 0
    scene.light_meshes.kI = 2
    assert check() == 0
    scene.camera.location.z = 12
    assert check() == 0
    b.data.vertices[0].co.x += 0.5
    b.data.update()
    assert check() == 1
    b.modifiers.new("Subdivision", 'SUBSURF')
    assert check() == 1
    b.modifiers[0].levels = 2
    assert check() == 1
    b.data.materials.append(diffuse(name="Blue"))
    assert check() == 1
    bpy.data.objects.remove(a)
    assert check() == 0
    c = ball(add, "C", 1)
    assert check() == 1
    c.hide_viewport = True
    assert check() == 0
    c.hide_viewport = False
    assert check() == 1


def test_instances(scene, add, add_plane, watched, check):
    a = ball(add, "A")
    others = [add(a.data, name=f"Copy {i}", location=(i, 0, 0)) for i in range(3)]
    assert check() == 1
    a.data.vertices[0].co.z += 1
    a.data.update()
    assert check() == 1
    others[1].modifiers.new("Wave", 'DECIMATE').ratio = 0.5
    assert check() <= 2
    empty = add(None, name="Instancer")
    collection = bpy.data.collections.new("Group")
    collection.objects.link(a)
    empty.instance_type, empty.instance_collection = 'COLLECTION', collection
    assert check() <= 1
    empty.location.y = 3
    assert check() == 0
    a.data.vertices[1].co.z += 1
    a.data.update()
    assert check() >= 1


def test_frames_and_dependencies(scene, add, add_plane, watched, check):
    """A boolean's operand, a shape key, a curve's bevel: who depends on what changed is read again."""
    a, b = ball(add, "A"), ball(add, "B", location=(0.5, 0, 0))
    boolean = a.modifiers.new("Boolean", 'BOOLEAN')
    boolean.object, boolean.solver = b, 'EXACT'
    plane = add_plane(name="Plane")
    plane.shape_key_add(name="Basis")
    key = plane.shape_key_add(name="Key")
    key.data[0].co.z = 1
    key.value = 0
    key.keyframe_insert("value", frame=1)
    key.value = 1
    key.keyframe_insert("value", frame=10)
    curve = bpy.data.curves.new("Curve", 'CURVE')
    curve.dimensions, curve.bevel_depth = '3D', 0.1
    curve.splines.new('POLY').points.add(2)
    for i, point in enumerate(curve.splines[0].points):
        point.co = (i, i % 2, 0, 1)
    add(curve)
    scene.frame_set(1)
    assert check() == 4
    b.location.x = 0.9
    assert check() == 1
    scene.frame_set(5)
    assert check() == 1
    curve.bevel_depth = 0.2
    assert check() == 1


def test_slices(scene, add, watched, check):
    """However short the slices, the same comes out, and each gets something done."""
    for i in range(20):
        ball(add, f"Ball {i}", i % 3 + 1, location=(i, 0, 0))
    assert check(0.0) == 20
    scene.objects["Ball 3"].location.z = 1
    assert check(0.0) == 0


def test_an_update_in_the_middle_begins_anew(scene, add, watched, check):
    for i in range(4):
        ball(add, f"Ball {i}", 3)
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for _ in range(6):
        assert watched.scenes.advance(depsgraph, 0.0, None, lambda ob: True) is None
    bpy.data.objects.remove(scene.objects["Ball 0"])
    scene.objects["Ball 1"].data.vertices[0].co.x = 5
    scene.objects["Ball 1"].data.update()
    check()


def test_what_is_being_exported_stays(scene, add, watched, check, monkeypatch):
    """Blocks that no scene names yet are not removed when the engine has read an older scene."""
    monkeypatch.setattr("light_meshes_addon.export.blocks.FULL", 300)
    balls = [ball(add, f"Ball {i}", 3) for i in range(3)]
    first = watched.export()
    for ob in balls:
        ob.data.vertices[0].co.x = 5
        ob.data.update()
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for _ in range(9):
        assert watched.scenes.advance(depsgraph, 0.0, None, lambda ob: True) is None
    watched.scenes.only(first)
    check()


def test_many_edits(scene, add, add_light, diffuse, watched, check, monkeypatch):
    """Random edits: always what a fresh export gives; blocks and files stay few."""
    monkeypatch.setattr("light_meshes_addon.export.blocks.FULL", 500)
    monkeypatch.setattr("light_meshes_addon.export.blocks.MOST", 8)
    chance = random.Random(4)
    materials = [diffuse((i / 5, 0.5, 0.5), f"Material {i}") for i in range(5)]
    objects = [ball(add, f"Ball {i}", chance.randint(1, 3)) for i in range(12)]
    add_light()
    for step in range(60):
        ob = chance.choice(objects)
        what = chance.randrange(6)
        if what == 0:
            ob.location.x += 1
        elif what <= 2:
            ob.data.vertices[0].co.x += 0.1
            ob.data.update()
        elif what == 3:
            ob.data.materials.append(chance.choice(materials))
        elif what == 4:
            objects.remove(ob)
            bpy.data.objects.remove(ob)
            objects.append(ball(add, f"New {step}", chance.randint(1, 3)))
        else:
            chance.choice(materials).diffuse_color[0] = chance.random()
            chance.choice(materials).node_tree.nodes["Diffuse BSDF"].inputs[0].default_value[1] = chance.random()
        check()
    scene_file = watched.export()
    watched.scenes.only(scene_file)
    while not watched.scenes.written():
        pass
    names = {p.name for p in watched.folder.iterdir()}
    data = json.loads(scene_file.read_text())
    assert names == {scene_file.name, data["instances"], *data["blocks"]}
    stored = sum(len(np.load(watched.folder / b / "triangles.npy")) for b in data["blocks"])
    live = sum(len(ob.data.polygons) for ob in objects)
    assert len(data["blocks"]) <= 20 and stored <= 3 * live + 500


def test_painted_images(scene, add_plane, watched, check):
    """An image that Blender alone has is written again when it changes, and its old file goes."""
    plane = add_plane()
    plane.data.uv_layers.new()
    image = bpy.data.images.new("Painted", 4, 4)
    image.pixels[:] = [0.25] * 64
    material = bpy.data.materials.new("Painted")
    material.use_nodes = True
    tree = material.node_tree
    node = tree.nodes.new('ShaderNodeTexImage')
    node.image = image
    shader = next(n for n in tree.nodes if n.bl_idname == 'ShaderNodeBsdfPrincipled')
    tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    plane.data.materials.append(material)
    check()
    image.pixels[:] = [0.75] * 64
    image.update()
    image.update_tag()
    material.update_tag()
    check()
    path = watched.export()
    scene = light_meshes.scene.snapshot.read(path)
    assert len(scene.images) == 1 and len(list(watched.folder.glob("image-*.tif"))) == 1
    plane.data.materials.clear()
    check()
    plane.data.materials.append(material)
    check()
