"""The exported camera sees what Blender's camera sees."""

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

POINTS = [(0.3, 0.2, 0.1), (-1.5, 0.4, -2), (2, -1, 1), (0, 0, 0), (-0.7, -1.3, 3)]


def project(camera, point):
    """Where the engine's camera puts a point, in 0..1 of the whole frame."""
    local = np.linalg.inv(camera.matrix) @ [*point, 1]
    x, y = local[:2] / -local[2] if camera.perspective else local[:2]
    left, right, bottom, top = camera.window
    return (x - left) / (right - left), (y - bottom) / (top - bottom)


@pytest.mark.parametrize("size", [(64, 48), (48, 64), (50, 50)])
@pytest.mark.parametrize("aspect", [(1, 1), (2, 1), (1, 1.7)])
@pytest.mark.parametrize("fit", ['AUTO', 'HORIZONTAL', 'VERTICAL'])
@pytest.mark.parametrize("kind", ['PERSP', 'ORTHO'])
def test_projection(scene, add_plane, snapshot, size, aspect, fit, kind):
    add_plane()
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = aspect
    lens = scene.camera.data
    lens.type, lens.sensor_fit = kind, fit
    lens.lens, lens.ortho_scale = 35, 7
    lens.sensor_width, lens.sensor_height = 30, 18
    lens.shift_x, lens.shift_y = 0.13, -0.21
    lens.clip_start, lens.clip_end = 0.5, 50
    scene.camera.location = (3, -4, 9)
    scene.camera.rotation_euler = (0.5, 0.2, 0.9)
    scene.camera.scale = (2, 0.5, 3)  # does not matter
    camera = snapshot(scene).camera
    assert (camera.width, camera.height) == size and camera.perspective == (kind == 'PERSP')
    assert (camera.clip_start, camera.clip_end) == (0.5, 50) and camera.crop is None
    assert np.allclose(camera.matrix[:3, :3].T @ camera.matrix[:3, :3], np.eye(3), atol=1e-6)
    for point in POINTS:
        # world_to_camera_view takes the frame from the camera's own view_frame, not from our formula.
        wanted = world_to_camera_view(scene, scene.camera, Vector(point))
        assert project(camera, point) == pytest.approx((wanted.x, wanted.y), abs=2e-5)


def test_resolution_percentage_and_border(scene, add_plane, snapshot):
    add_plane()
    scene.render.resolution_x, scene.render.resolution_y = 200, 101
    scene.render.resolution_percentage = 50
    assert (snapshot(scene).camera.width, snapshot(scene).camera.height) == (100, 50)
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.25, 0.5
    scene.render.border_min_y, scene.render.border_max_y = 0.1, 0.9
    camera = snapshot(scene).camera
    assert (camera.width, camera.height) == (100, 50) and camera.crop == (25, 5, 50, 45)


@pytest.mark.parametrize("crop", [False, True])
def test_border_in_the_picture(scene, add_plane, add_light, render, crop):
    """A border's pixels are those of the whole picture, wherever Blender puts them."""
    add_plane(1)
    add_light('SUN', energy=3)
    scene.view_layers[0].use_pass_z = True
    scene.light_meshes.auto_h = False
    whole = render(scene)
    render_settings = scene.render
    render_settings.use_border, render_settings.use_crop_to_border = True, crop
    render_settings.border_min_x, render_settings.border_max_x = 0.33, 0.71
    render_settings.border_min_y, render_settings.border_max_y = 0.2, 0.62
    part = render(scene)
    x0, x1, y0, y1 = 21, 45, 9, 29  # cut off, bottom-up
    inside = (slice(48 - y1, 48 - y0), slice(x0, x1))
    for name in ("Combined", "Depth"):
        if crop:
            assert part[name].shape[:2] == (y1 - y0, x1 - x0)
            assert np.array_equal(part[name], whole[name][inside])
        else:
            assert part[name].shape == whole[name].shape
            assert np.array_equal(part[name][inside], whole[name][inside])
            outside = np.ones((48, 64), bool)
            outside[inside] = False
            assert not part["Combined"][outside].any()


def test_a_border_without_pixels_is_an_error(scene, add_plane, snapshot):
    add_plane()
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.5, 0.501
    with pytest.raises(RuntimeError):
        snapshot(scene)


def test_no_camera_is_an_error(scene, add_plane, render):
    add_plane()
    scene.camera = None
    with pytest.raises(RuntimeError, match="camera"):
        render(scene)


def test_warnings(scene, add_plane, snapshot):
    add_plane()
    scene.camera.data.type = 'PANO'
    scene.render.use_motion_blur = True
    warnings = snapshot(scene).warnings
    assert [any(word in w for w in warnings) for word in ("pano", "Motion Blur")] == [True] * 2
    scene.view_layers[0].use_motion_blur = False
    assert not any("Motion" in w for w in snapshot(scene).warnings)


def test_depth_of_field(scene, add, add_plane, snapshot):
    add_plane()
    scene.light_meshes.samples = 16
    lens = scene.camera.data
    assert snapshot(scene).camera.lens_radius == 0
    lens.dof.use_dof, lens.dof.aperture_fstop, lens.dof.focus_distance = True, 2.0, 3.0
    lens.dof.aperture_blades, lens.dof.aperture_rotation, lens.dof.aperture_ratio = 5, 0.25, 1.5
    lens.lens = 80
    found = snapshot(scene)
    assert not found.warnings
    camera = found.camera
    assert (camera.lens_radius, camera.focus_distance) == pytest.approx((0.02, 3))  # 80 mm/2 across
    assert (camera.lens_blades, camera.lens_rotation, camera.lens_ratio) == pytest.approx((5, 0.25, 1.5))
    lens.type = 'ORTHO'
    assert snapshot(scene).camera.lens_radius == pytest.approx(0.25)
    # The distance of an object is measured along the view, whatever the camera's scale.
    scene.camera.scale = (2, 2, 2)
    lens.dof.focus_object = add(None, "Focus", location=(5, 4, 3))
    assert snapshot(scene).camera.focus_distance == pytest.approx(7)
    armature = bpy.data.armatures.new("Armature")
    rig = add(armature, location=(0, 0, 1))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode='EDIT')
    bone = armature.edit_bones.new("Bone")
    bone.head, bone.tail = (1, 0, 3), (1, 0, 4)
    bpy.ops.object.mode_set(mode='OBJECT')
    lens.dof.focus_object, lens.dof.focus_subtarget = rig, "Bone"
    assert snapshot(scene).camera.focus_distance == pytest.approx(6)


def test_depth_of_field_with_few_samples_is_a_warning(scene, add_plane, snapshot):
    add_plane()
    scene.camera.data.dof.use_dof = True
    scene.light_meshes.samples = 15
    (warning,) = snapshot(scene).warnings
    assert "Depth of field" in warning and "Samples" in warning and "15" in warning


def test_camera_of_the_frame(scene, add, add_plane, snapshot):
    """Markers switch cameras."""
    add_plane()
    other = add(bpy.data.cameras.new("Other"), location=(0, 0, 5))
    marker = scene.timeline_markers.new("Cut", frame=3)
    marker.camera = other
    scene.frame_set(5)
    assert snapshot(scene).camera.matrix[2, 3] == 5
