"""The buttons (presets, softening, a kept snapshot), and what the panels say about h, kI and r."""

import math

import bpy
import light_meshes.scene.snapshot
import numpy as np
import pytest
from light_meshes.picture.render import render_image


@pytest.fixture
def lit(scene, add_plane, add_light, diffuse):
    """A plane seen straight from above, 10 away, across which 20·36/50·... scene units are seen; a sun."""
    add_plane(20).data.materials.append(diffuse())
    add_light('SUN', energy=math.pi, angle=0)
    scene.light_meshes.bounces = 0
    return scene


def across(scene):
    """Width of what the camera sees at distance 10."""
    lens = scene.camera.data
    return 10 * lens.sensor_width / lens.lens


@pytest.mark.parametrize("level, nodes", [('DRAFT', 17), ('BALANCED', 57), ('FINE', 134)])
def test_presets(scene, level, nodes):
    from light_meshes_addon import operators, penumbra

    own = scene.light_meshes
    own.auto_h, own.h, own.kI = False, 0.1, 2.5
    assert not any(p.is_set(own) for p in operators.PRESETS.values())
    assert bpy.ops.light_meshes.preset(level=level) == {'FINISHED'}
    assert [key for key, p in operators.PRESETS.items() if p.is_set(own)] == [level]
    assert own.h * own.kI == pytest.approx(0.25)  # shadow edges stay as wide
    assert penumbra.nodes(own.kI) == nodes


def test_the_balanced_preset_is_the_default(scene):
    from light_meshes_addon import operators

    scene.light_meshes.property_unset("bounces")
    assert operators.PRESETS['BALANCED'].is_set(scene.light_meshes)


def test_lamps_with_a_size_are_softened(lit, add_light, snapshot):
    from light_meshes_addon.ui.light import _meaning

    lit.light_meshes.auto_h = False
    with pytest.raises(RuntimeError, match="no lamp has a size"):
        bpy.ops.light_meshes.soften()
    assert not lit.light_meshes.auto_h
    lamp = add_light('POINT', shadow_soft_size=0.2).data
    assert bpy.ops.light_meshes.soften() == {'FINISHED'}
    assert lit.light_meshes.auto_h
    assert [light.softness for light in snapshot(lit).lights] == ["SCENE", "SIZE"]  # Sun, Point
    assert _meaning(lit, lamp, "Point") == [("Shadow Edges", "wider farther from what casts them")]
    lamp.shadow_soft_size = 0
    assert _meaning(lit, lamp, "Point") == [("Shadow Edges", "sharp: no size")]


def test_a_kept_snapshot_is_what_is_rendered(lit, add_plane, render, tmp_path):
    from light_meshes_addon.render_engine import LightMeshesEngine

    add_plane(1, "Hidden", location=(0, 0, 1)).hide_viewport = True  # but not in renders
    picture = render(lit)["Combined"]
    for expected in ("snapshot-untitled-Scene-1", "snapshot-untitled-Scene-1-2"):
        assert bpy.ops.light_meshes.keep_snapshot(directory=str(tmp_path)) == {'FINISHED'}
        again = render_image(light_meshes.scene.snapshot.read(tmp_path / expected)).passes["Combined"]
        assert np.array_equal(again[::-1], picture)
    assert LightMeshesEngine.export_to is None and lit.render.use_compositing and lit.render.use_sequencer


def test_a_snapshot_that_cannot_be_kept(lit, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RuntimeError, match="file/snapshot-untitled-Scene-1 cannot be made"):
        bpy.ops.light_meshes.keep_snapshot(directory=str(tmp_path / "file"))
    lit.camera = None
    with pytest.raises(RuntimeError, match="no camera"):
        bpy.ops.light_meshes.keep_snapshot(directory=str(tmp_path))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("kind", ['PERSP', 'ORTHO'])
def test_the_panels_pixels_are_those_of_the_picture(lit, add_mesh, render, kind):
    """A shadow's edge is as many pixels wide as the panel says, by its second moment."""
    from light_meshes_addon import penumbra

    lens = lit.camera.data
    lens.type, lens.ortho_scale = kind, across(lit)
    add_mesh("Blocker", [(0, -9, 1), (9, -9, 1), (9, 9, 1), (0, 9, 1)], [(0, 1, 2, 3)], visible_camera=False)
    lit.render.resolution_x, lit.render.resolution_y, lit.render.resolution_percentage = 400, 20, 50
    lit.render.filter_size = 0.01
    own = lit.light_meshes
    assert penumbra.step(lit) is None and penumbra.nodes(3) == 57  # not rendered yet
    assert penumbra.pixels(lit, None)[0] == pytest.approx(2 * 3)  # r = 3·200/200
    own.auto_h, own.h, own.kI = False, 0.15, 4
    lens.dof.focus_distance = 10
    row = render(lit)["Combined"][5, :, 0]
    share = np.diff(row) / (row[-1] - row[0])
    place = np.arange(len(share))
    spread = math.sqrt((share * (place - (share * place).sum()) ** 2).sum())  # of smootherstep: its width/√28
    assert penumbra.pixels(lit, 0.6)[0] == pytest.approx(spread * math.sqrt(28), rel=0.05)
    assert penumbra.pixels(lit, 0.6)[1] == ("everywhere" if kind == 'ORTHO' else "at the focus distance, 10 m")


def test_pixels_at_the_focus(lit, add):
    from light_meshes_addon import penumbra

    lens = lit.camera.data
    lens.dof.use_dof, lens.dof.focus_distance = True, 5
    near, where = penumbra.pixels(lit, 0.1)
    assert "at the focus, 5 m" in where and near == pytest.approx(0.2 / across(lit) * 2 * 64)
    lens.dof.focus_object = add(None, "Target", location=(3, 0, -10))
    bpy.context.view_layer.update()
    assert penumbra.pixels(lit, 0.1)[0] == pytest.approx(near / 4)
    lit.camera = None
    assert penumbra.pixels(lit, 0.1) is None


def test_the_measured_step_is_shown(lit, render):
    from light_meshes_addon import penumbra, session

    render(lit)
    assert penumbra.step(lit) == session.statistics["h"] == pytest.approx(across(lit) / 200, rel=0.05)
    width, where = penumbra.pixels(lit, 3 * penumbra.step(lit))
    assert width == pytest.approx(2 * 3 / 200 * 64) and where == "in the middle of what is seen"
    other = bpy.data.scenes.new("Other")
    assert penumbra.step(other) is None


def test_a_lights_radius_is_shown(lit, add_plane, render):
    from light_meshes_addon import penumbra

    sun = lit.objects["Sun"].data
    own = sun.light_meshes
    lit.light_meshes.auto_h, lit.light_meshes.h = False, 0.05
    assert penumbra.light_radius(lit, sun, "Sun") == pytest.approx(0.15)
    own.softness, own.radius = 'RADIUS', 0.2
    assert penumbra.light_radius(lit, sun, "Sun") == pytest.approx(0.2)
    own.softness, own.reference_distance, sun.angle = 'LIGHT_SIZE', 2, 2 * math.atan(0.1)
    add_plane(1, "Blocker", location=(0, 0, 1))
    assert penumbra.light_radius(lit, sun, "Sun") is None
    render(lit)
    assert penumbra.light_radius(lit, sun, "Sun") == pytest.approx(1.32 * 0.1 * 2, rel=0.01)


@pytest.mark.parametrize("system, unit, scale, text", [
    ('METRIC', 'METERS', 1.0, "0.25 m"), ('METRIC', 'METERS', 0.01, "0.0025 m"), ('METRIC', 'ADAPTIVE', 1.0, "25 cm"),
    ('IMPERIAL', 'INCHES', 1.0, "9.843\""), ('NONE', 'METERS', 1.0, "0.25"),
])
def test_lengths(scene, system, unit, scale, text):
    from light_meshes_addon import penumbra

    units = scene.unit_settings
    units.system = system
    if system != 'NONE':
        units.length_unit = unit
    units.scale_length = scale
    assert penumbra.length(scene, 0.25).startswith(text)


def test_the_statistics_are_readable(lit, render):
    from light_meshes_addon import session
    from light_meshes_addon.ui import last_render

    lit.frame_set(7)
    render(lit)
    rows = dict(last_render.rows(session.statistics, lit))
    assert rows["Picture"].startswith("Scene, frame 7, 64×48, 4 samples")
    assert rows["Scene"] == "2 triangles, 1 light" and "12,288 camera" in rows["Rays"]
    assert rows["Without Node"].startswith("0 points")
    lit.light_meshes.shadows = 'SHARP'
    render(lit)
    assert "Nodes" not in dict(last_render.rows(session.statistics, lit))


def test_the_statistics_of_lamps_with_a_size(lit, render):
    """They have h too, in the panel, on the console and on the view's line; r is of lights of one width."""
    from light_meshes_addon import job, session, viewport
    from light_meshes_addon.ui import last_render

    lamp, = (ob.data for ob in lit.objects if ob.type == 'LIGHT')
    lamp.light_meshes.softness = 'SIZE'
    if lamp.type == 'SUN':
        lamp.angle = 0.2
    else:
        lamp.shadow_soft_size = 0.2
    lit.light_meshes.auto_h, lit.light_meshes.h = False, 0.3  # in so small a picture nodes of finer steps are not asked
    render(lit)
    s = session.statistics
    rows = dict(last_render.rows(s, lit))
    assert rows["Lattice"].startswith("h ") and rows["Lamps with a Size"].endswith("% are near penumbrae")
    line = viewport.summary(s)
    assert f", h {s['h']:.3g}" in line and ", r " not in line
    assert f"h {s['h']:.4g}, {s['nodes']:,} nodes" in job.summary(s)
    lamp.light_meshes.softness = 'SCENE'
    render(lit)
    s = session.statistics
    assert f", r {s['r']:.3g}" in viewport.summary(s) and f", r {s['r']:.4g}, " in job.summary(s)
    assert "Lamps with a Size" not in dict(last_render.rows(s, lit))
    assert "Light Threshold" not in dict(last_render.rows(s, lit))
    second = lamp.copy()
    second.light_meshes.softness = 'SCENE'
    lit.collection.objects.link(bpy.data.objects.new("Second", second))
    lit.light_meshes.light_threshold = 1.0
    render(lit)
    row = dict(last_render.rows(session.statistics, lit))["Light Threshold"]
    assert row == (f"on average the light is wrong by less than {session.statistics['light_bound']:.2%} of that "
                   "without shadows")
