"""Every kind of object becomes triangles in the place where Blender shows it."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix


def instances(found):
    """Object name → its instances' matrices."""
    result = {}
    for o, m in zip(found.geometry.instance_object, found.geometry.instance_matrix, strict=True):
        result.setdefault(found.objects[o].name, []).append(m)
    return result


def triangles_of(found, name):
    """World-space corners (T,3,3), corner normals (T,3,3) as stored, and materials of the one instance of `name`."""
    g = found.geometry
    i = next(i for i, o in enumerate(g.instance_object) if found.objects[o].name == name)
    v0, nv, t0, nt = g.meshes[g.instance_mesh[i]]
    matrix = g.instance_matrix[i]
    points = g.vertices[v0:v0 + nv] @ matrix[:3, :3].T + matrix[:3, 3]
    part = slice(t0, t0 + nt)
    return points[g.triangles[part]], g.corner_normals[part], g.triangle_materials[part]


def area(corners):
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2


def test_a_quad(scene, add_plane, snapshot):
    add_plane(1, location=(1, 2, 3), scale=(2, 1, 1))
    corners, normals, materials = triangles_of(snapshot(scene), "Plane")
    assert len(corners) == 2 and area(corners) == pytest.approx(8)
    assert corners.reshape(-1, 3).min(0) == pytest.approx((-1, 1, 3))
    assert np.allclose(normals, (0, 0, 1)) and set(materials) == {0}
    # Counter-clockwise from outside.
    assert np.cross(corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0])[2] > 0


def test_modifiers_of_the_render(scene, add_plane, snapshot):
    """A render's levels, not the viewport's; and modifiers that are off in renders stay off."""
    plane = add_plane()
    modifier = plane.modifiers.new("Subdivision", 'SUBSURF')
    modifier.subdivision_type, modifier.levels, modifier.render_levels = 'SIMPLE', 1, 3
    assert len(snapshot(scene).geometry.triangles) == 2 * 4**3
    modifier.show_render = False
    assert len(snapshot(scene).geometry.triangles) == 2
    modifier = plane.modifiers.new("Array", 'ARRAY')
    modifier.count = 5
    assert len(snapshot(scene).geometry.triangles) == 10


def test_normals(scene, snapshot, add):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
    sphere = bpy.context.object
    corners, normals, _ = triangles_of(snapshot(scene), "Sphere")
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    assert np.allclose(normals, flat[:, None], atol=2e-3)  # a quad's triangles are not quite in one plane

    sphere.data.polygons.foreach_set("use_smooth", [True] * len(sphere.data.polygons))
    sphere.data.update()
    corners, normals, _ = triangles_of(snapshot(scene), "Sphere")
    assert np.allclose(normals, corners / np.linalg.norm(corners, axis=2, keepdims=True), atol=0.01)
    assert np.allclose(np.linalg.norm(normals, axis=2), 1, atol=1e-5)

    sphere.data.normals_split_custom_set([(0.6, 0, 0.8)] * len(sphere.data.loops))
    _, normals, _ = triangles_of(snapshot(scene), "Sphere")
    assert np.abs(normals - (0.6, 0, 0.8)).max() < 0.02  # Blender stores them coarsely


def test_sharp_edges_split_normals(scene, snapshot):
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    cube.data.polygons.foreach_set("use_smooth", [True] * 6)
    for edge in cube.data.edges:
        edge.use_edge_sharp = True
    cube.data.update()
    _, normals, _ = triangles_of(snapshot(scene), "Cube")
    assert np.allclose(np.abs(normals).max(axis=2), 1, atol=1e-6)


def test_materials_of_faces(scene, add_mesh, diffuse, snapshot):
    strip = add_mesh("Strip", [(x, y, 0) for x in range(5) for y in (0, 1)],
                     [(2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1) for i in range(4)])
    for color in ((1, 0, 0), (0, 1, 0)):
        strip.data.materials.append(diffuse(color, name=f"M{color[0]}"))
    strip.data.materials.append(None)
    strip.data.polygons.foreach_set("material_index", [0, 1, 2, 9])  # 9 does not exist: Blender uses the last
    found = snapshot(scene)
    _, _, materials = triangles_of(found, "Strip")
    assert [found.materials[m].name for m in materials] == ["M1"] * 2 + ["M0"] * 2 + ["default"] * 4


def test_material_of_the_object(scene, add_plane, add, diffuse, snapshot):
    """Two objects share a mesh, one with a material of its own."""
    first = add_plane(name="First")
    first.data.materials.append(diffuse(name="Of the mesh"))
    second = add(first.data, "Second")
    third = add(first.data, "Third")
    second.material_slots[0].link = 'OBJECT'
    second.material_slots[0].material = diffuse(name="Of the object")
    assert third
    found = snapshot(scene)
    names = {o: found.materials[triangles_of(found, o)[2][0]].name for o in ("First", "Second", "Third")}
    assert names == {"First": "Of the mesh", "Second": "Of the object", "Third": "Of the mesh"}
    assert len(found.geometry.meshes) == 2 and len(found.geometry.instance_mesh) == 3


def test_negative_scale(scene, add_plane, snapshot, add_light, render):
    """A mirrored object is lit as it is seen."""
    plane = add_plane(3)
    add_light('SUN', energy=3, angle=0)
    plain = render(scene)["Combined"]
    plane.scale = (-1, 1, 1)
    found = snapshot(scene)
    assert np.linalg.det(found.geometry.instance_matrix[0][:3, :3]) < 0
    mirrored = render(scene)["Combined"]
    assert plain[24, 32, 0] > 0.1 and np.allclose(plain, mirrored, atol=1e-4)


@pytest.mark.parametrize("kind", ["curve", "surface", "font", "meta"])
def test_what_becomes_a_mesh(scene, diffuse, snapshot, kind):
    if kind == "curve":
        bpy.ops.curve.primitive_bezier_circle_add(radius=2)
        bpy.context.object.data.bevel_depth = 0.1
    elif kind == "surface":
        bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    elif kind == "font":
        bpy.ops.object.text_add()
        bpy.context.object.data.extrude = 0.1
    else:
        bpy.ops.object.metaball_add(type='BALL', radius=2)
    bpy.context.object.data.materials.append(diffuse(name="Its own"))
    found = snapshot(scene)
    assert [m.name for m in found.materials] == ["Its own"]
    assert len(found.geometry.instance_mesh) == 1 and len(found.geometry.triangles) > 50
    assert not found.warnings
    lengths = np.linalg.norm(found.geometry.corner_normals, axis=2)
    assert np.allclose(lengths, 1, atol=1e-4)


def test_curve_modifiers_belong_to_the_object(scene, add, snapshot):
    """Two objects share a curve; one has a modifier."""
    bpy.ops.curve.primitive_bezier_circle_add()
    first = bpy.context.object
    first.data.bevel_depth = 0.1
    second = add(first.data, "Second", location=(3, 0, 0))
    second.modifiers.new("Array", 'ARRAY').count = 2
    found = snapshot(scene)
    counts = sorted(found.geometry.meshes[:, 3].tolist())
    assert len(counts) == 2 and counts[1] == 2 * counts[0]


def test_a_bare_curve_and_an_empty_mesh_are_nothing(scene, add, snapshot):
    bpy.ops.curve.primitive_bezier_circle_add()
    bpy.context.object.data.fill_mode = 'FULL'
    add(bpy.data.meshes.new("Nothing"))
    add(None, "Empty")
    found = snapshot(scene)
    assert len(found.geometry.instance_mesh) == 0 and len(found.geometry.triangles) == 0


def test_collection_instances(scene, add_plane, add, snapshot):
    plane = add_plane(location=(0, 0, 1))
    collection = bpy.data.collections.new("Things")
    collection.objects.link(plane)
    scene.collection.objects.unlink(plane)
    for x in (-2, 2):
        add(None, f"Instancer {x}", instance_type='COLLECTION', instance_collection=collection, location=(x, 0, 0),
            scale=(1, 1, 3))
    found = snapshot(scene)
    assert len(found.geometry.meshes) == 1
    assert sorted(m[:3, 3].tolist() for m in instances(found)["Plane"]) == [[-2, 0, 3], [2, 0, 3]]
    assert all(m[2, 2] == 3 for m in instances(found)["Plane"])


def test_vertex_instances(scene, add_mesh, add_plane, snapshot):
    parent = add_mesh("Parent", [(x, 0, 0) for x in range(5)], [])
    parent.instance_type = 'VERTS'
    child = add_plane(0.1, name="Child")
    child.parent = parent
    found = snapshot(scene)
    assert sorted(m[0, 3] for m in instances(found)["Child"]) == pytest.approx([0, 1, 2, 3, 4])
    assert len(found.geometry.meshes) == 1


def test_particles(scene, add_plane, snapshot):
    emitter, stone = add_plane(5, name="Emitter"), add_plane(0.1, name="Stone", location=(50, 0, 0))
    emitter.modifiers.new("Particles", 'PARTICLE_SYSTEM')
    settings = emitter.particle_systems[0].settings
    settings.type, settings.count = 'HAIR', 40
    settings.render_type, settings.instance_object = 'OBJECT', stone
    found = snapshot(scene)
    assert len(instances(found)["Stone"]) == 41 and len(found.geometry.meshes) == 2


def test_geometry_nodes(scene, add_plane, diffuse, snapshot):
    """Instances of geometry that no object has, with a material set by a node."""
    plane = add_plane(1, name="Ground")
    tree = bpy.data.node_groups.new("Scatter", 'GeometryNodeTree')
    tree.interface.new_socket("Geometry", in_out='INPUT', socket_type='NodeSocketGeometry')
    tree.interface.new_socket("Geometry", in_out='OUTPUT', socket_type='NodeSocketGeometry')
    make = tree.nodes.new
    given, result = make('NodeGroupInput'), make('NodeGroupOutput')
    scatter, cube, ball = make('GeometryNodeInstanceOnPoints'), make('GeometryNodeMeshCube'), \
        make('GeometryNodeMeshIcoSphere')
    second, join, paint = make('GeometryNodeInstanceOnPoints'), make('GeometryNodeJoinGeometry'), \
        make('GeometryNodeSetMaterial')
    paint.inputs["Material"].default_value = diffuse(name="Painted")
    link = tree.links.new
    link(given.outputs[0], scatter.inputs["Points"])
    link(given.outputs[0], second.inputs["Points"])
    link(cube.outputs[0], paint.inputs["Geometry"])
    link(paint.outputs[0], scatter.inputs["Instance"])
    link(ball.outputs[0], second.inputs["Instance"])
    for source in (scatter, second):
        link(source.outputs[0], join.inputs[0])
    link(join.outputs[0], result.inputs[0])
    plane.modifiers.new("Nodes", 'NODES').node_group = tree
    found = snapshot(scene)
    assert sorted(found.geometry.meshes[:, 3].tolist()) == [12, 20]
    assert len(found.geometry.instance_mesh) == 8
    cube_mesh = int(np.argmin(found.geometry.meshes[:, 3]))
    first = found.geometry.meshes[cube_mesh][2]
    assert found.materials[found.geometry.triangle_materials[first]].name == "Painted"
    places = [m[:2, 3] for m, i in zip(found.geometry.instance_matrix, found.geometry.instance_mesh, strict=True)
              if i == cube_mesh]
    assert sorted(map(tuple, places)) == [(-1, -1), (-1, 1), (1, -1), (1, 1)]


def test_visibility(scene, add_plane, add, snapshot):
    for name, flags in {
        "Seen": {}, "Off": {"hide_render": True}, "No camera": {"visible_camera": False},
        "No mirror": {"visible_glossy": False}, "No shadow": {"visible_shadow": False},
    }.items():
        add_plane(name=name, **flags)
    parent = add_plane(name="Instancer", show_instancer_for_render=False, instance_type='VERTS')
    child = add_plane(name="Child")
    child.parent = parent
    objects = {o.name: o for o in snapshot(scene).objects}
    assert set(objects) == {"Seen", "No camera", "No mirror", "No shadow", "Child"}
    seen = {n: (o.visible_camera, o.visible_reflection, o.visible_shadow) for n, o in objects.items()}
    assert seen["Seen"] == (True, True, True) and seen["No camera"] == (False, True, True)
    assert seen["No mirror"] == (True, False, True) and seen["No shadow"] == (True, True, False)


def test_an_instancers_visibility_counts(scene, add_plane, add, snapshot):
    plane = add_plane()
    collection = bpy.data.collections.new("Things")
    collection.objects.link(plane)
    scene.collection.objects.unlink(plane)
    add(None, "Ghost", instance_type='COLLECTION', instance_collection=collection, visible_shadow=False)
    add(None, "Solid", instance_type='COLLECTION', instance_collection=collection)
    assert sorted(o.visible_shadow for o in snapshot(scene).objects) == [False, True]


def test_what_is_not_translated_is_named(scene, add_plane, add, snapshot):
    plane = add_plane(name="Hairy")
    plane.modifiers.new("Hair", 'PARTICLE_SYSTEM')
    plane.particle_systems[0].settings.type = 'HAIR'
    add(bpy.data.volumes.new("Fog"))
    warnings = snapshot(scene).warnings
    assert [sum(f"'{n}'" in w for w in warnings) for n in ("Hairy", "Fog")] == [1, 1]


def test_deformation_and_animation_of_the_frame(scene, add_plane, snapshot):
    plane = add_plane()
    plane.shape_key_add(name="Basis")
    key = plane.shape_key_add(name="Up")
    for point in key.data:
        point.co.z = 2
    for frame, value in ((1, 0.0), (11, 1.0)):
        key.value = value
        key.keyframe_insert("value", frame=frame)
        plane.location.x = 10 * value
        plane.keyframe_insert("location", frame=frame)
    scene.frame_set(11)
    corners, _, _ = triangles_of(snapshot(scene), "Plane")
    assert np.allclose(corners[..., 2], 2) and corners[..., 0].mean() == pytest.approx(10)


def test_parents_and_sheared_matrices(scene, add_plane, add, snapshot):
    parent = add(None, "Parent", scale=(1, 3, 1))
    plane = add_plane(rotation_euler=(0, 0, 0.7))
    plane.parent = parent
    matrix = instances(snapshot(scene))["Plane"][0]
    assert np.allclose(matrix, np.array(Matrix.Diagonal((1, 3, 1, 1)) @ Matrix.Rotation(0.7, 4, 'Z')), atol=1e-6)


@pytest.mark.slow
def test_a_million_triangles(scene, snapshot, record_property):
    import time

    import light_meshes_addon.job

    bpy.ops.mesh.primitive_grid_add(x_subdivisions=708, y_subdivisions=708)
    times = []
    export = light_meshes_addon.job.export

    def timed(*arguments, **options):
        start = time.perf_counter()
        try:
            return export(*arguments, **options)
        finally:
            times.append(time.perf_counter() - start)

    light_meshes_addon.job.export = timed
    try:
        found = snapshot(scene)
    finally:
        light_meshes_addon.job.export = export
    assert len(found.geometry.triangles) > 1_000_000
    record_property("export_seconds", times[0])
    print(f"a million triangles: {times[0]:.2f} s")
    assert times[0] < 3
