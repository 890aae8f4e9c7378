"""For the camera, holdouts are holes and shadow catchers show only shadows; for all other rays both are ordinary
objects.
"""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, cylinder, rectangle, rotate_y, sphere, translate
from light_meshes.film.passes import NO_DEPTH, PASSES
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Material
from scenes import GREY, edge, look_down, point, settings, sun, tabletop, with_lights

WORLD = (0.3, 0.4, 0.6)
MIRROR = Material("mirror", Od=(0, 0, 0), kd=0.0, ka=0.0, mirror=(1.0, 1.0, 1.0))


def flagged(scene, name, **flags):
    """`scene` with flags on the object `name`."""
    return replace(scene, objects=tuple(replace(o, **flags) if o.name == name else o for o in scene.objects))


def ball_on_a_mirror(**values):
    """A ball over a floor whose left half mirrors; seen from above and aside."""
    parts = [Shape(rectangle((-3, -3), (0, 3), 0.0), MIRROR, "mirror"),
             Shape(rectangle((0, -3), (3, 3), 0.0), Material("floor"), "floor"),
             Shape(sphere(0.6, 32, 16), Material("ball", Od=(0.8, 0.3, 0.2), kt=values.pop("kt", (0, 0, 0))), "ball",
                   [np.array([[1, 0, 0, -0.2], [0, 1, 0, 0], [0, 0, 1, 1.2], [0, 0, 0, 1]], float)])]
    return Scene.from_shapes(parts, Camera.look_at((-3, -4, 3.5), (0, 0, 0.6), 40, 64, 64), [point((-2, -2, 5), 15.0)],
                             settings(mode="WHITTED", h=0.08, **values), world_color=WORLD)


@pytest.mark.parametrize("clear", [False, True])
@pytest.mark.parametrize("glass", [False, True])
def test_a_holdout_is_a_hole_and_nothing_else_changes(clear, glass):
    """Its mirror image and its shadow stay. Also where the scene has glass, whose rays take another way."""
    scene = ball_on_a_mirror(film_transparent=clear)
    if glass:
        scene = replace(scene, materials=(*scene.materials[:1], replace(scene.materials[1], alpha=0.999),
                                          *scene.materials[2:]))
    names = tuple(PASSES)
    full = render_image(flagged(scene, "ball", index=5), names).passes
    done = render_image(flagged(scene, "ball", index=5, holdout=True), names)
    hole = full["Object Index"][..., 0] == 5
    assert 0.05 < hole.mean() < 0.3 and done.statistics["plan"]["holdouts"].startswith("1")
    for name, pixels in done.passes.items():
        nothing = {"Depth": NO_DEPTH, "Mist": 1}.get(name, 0)  # as far away as can be
        np.testing.assert_array_equal(pixels[hole], nothing, err_msg=name)
        np.testing.assert_array_equal(pixels[~hole], full[name][~hole], err_msg=name)
    assert (full["Glossy"][~hole] != np.float32(WORLD)).any(-1).sum() > 100  # the mirror image is there


def test_holdouts_at_edges_behind_panes_and_with_holes_leave_their_share_open():
    white = Material("white", Od=(0, 0, 0), ka=0.0, kd=0.0, emission=(1.0, 1.0, 1.0))
    pane = Material("pane", Od=(0, 0, 0), ka=0.0, kd=0.0, kt=(0.5, 0.5, 0.5), emission=(0.25, 0.25, 0.25))
    half = replace(white, name="half", alpha=0.25)
    parts = [Shape(rectangle((-9, -9), (9, 9), 0.0), white, "ground"),
             Shape(rectangle((-4, -4), (0, 4), 1.0), half, "hole", flags={"holdout": True}),
             Shape(rectangle((-4, 0), (4, 4), 2.0), pane, "pane")]
    scene = Scene.from_shapes(parts, look_down(0, 0, 4, 32), [], settings())
    picture = render_image(scene).passes["Combined"]
    for x, y, expected in ((24, 8, [1, 1, 1, 1]), (8, 8, [0.75, 0.75, 0.75, 0.75]), (24, 24, [0.75, 0.75, 0.75, 1]),
                           (8, 24, [0.625, 0.625, 0.625, 0.875])):
        np.testing.assert_allclose(picture[y, x], expected, rtol=1e-6)
    soft = render_image(flagged(scene, "pane", visible_camera=False).with_settings(samples=16, filter_size=1.5))
    across = soft.passes["Combined"][8]
    np.testing.assert_allclose(across[:, 3], across[:, 0], rtol=1e-6)
    assert (np.diff(across[:, 3]) >= -1e-6).all() and len(np.unique(across[:, 3].round(4))) > 3


def catching(scene, name="floor", **changes):
    return flagged(scene, name, shadow_catcher=True).with_settings(**changes)


def test_a_catcher_in_the_light_is_not_there():
    scene = ball_on_a_mirror()
    gone = flagged(scene, "floor", visible_camera=False)
    names = tuple(n for n in PASSES if not n.startswith("Debug"))
    found, expected = (render_image(s, names).passes for s in (catching(scene), gone))
    shadow = (found["Combined"] != expected["Combined"]).any(-1)
    assert 0.01 < shadow.mean() < 0.2
    for name in names:
        np.testing.assert_array_equal(found[name][~shadow], expected[name][~shadow], err_msg=name)
    assert (found["Combined"][shadow] <= expected["Combined"][shadow]).all()
    assert (found["Environment"][shadow] == found["Combined"][..., :3][shadow]).all()
    np.testing.assert_array_equal(found["Position"], expected["Position"])  # it has no place


@pytest.mark.parametrize("kI", [3.0, 1.0])  # with 1 many sets are empty
def test_the_clear_film_under_a_catcher_has_the_shadow_as_alpha(kI):
    """One light and no ambient light: the ratio is S itself, whatever the blur."""
    scene = edge(kI=kI, h=0.1)
    shadow = render_image(scene, ("Shadow",)).passes["Shadow"][..., 0]
    picture = render_image(catching(scene, film_transparent=True)).passes["Combined"]
    assert not picture[..., :3].any()
    np.testing.assert_allclose(picture[..., 3], 1 - shadow, rtol=0, atol=1e-6)
    assert len(np.unique(shadow)) > 4 and shadow.min() == 0 and shadow.max() == 1


def test_the_ratio_is_that_of_the_light_that_arrives():
    """Two coloured suns and ambient light: the mean of (Σ S·Ω + Ia)/(Σ Ω + Ia), whatever the catcher's own material.
    What is behind the catcher is not seen.
    """
    colours, directions = np.array([(2.0, 1.0, 0.0), (0.5, 1.0, 0.0)]), np.array([(0.6, 0, -0.8), (-0.28, 0, -0.96)])
    lamps = [replace(sun(d), intensity=tuple(c), shadow_pass=n)
             for n, (c, d) in enumerate(zip(colours.tolist(), directions, strict=True))]
    black = Material("black", Od=(0.0, 0.1, 1.0), ka=0.1, kd=0.3, ks=0.9, nShiny=3.0)
    glow = Material("deep", ka=0.0, kd=0.0, emission=(2.0, 3.0, 4.0))
    parts = [Shape(rectangle((-9, -9), (9, 9), 0.0), black, "floor"),
             Shape(box((-0.5, -0.5, 0.5), (0.5, 0.5, 0.7)), GREY, "box", flags={"visible_camera": False}),
             Shape(rectangle((-9, -9), (9, 9), -1.0), glow, "deep")]
    scene = Scene.from_shapes(parts, look_down(0, 0, 4, 48), lamps, settings(h=0.1, ambient=0.5),
                              world_color=(0.2, 0.4, 0.6))
    S = render_image(scene, ("Shadow 0", "Shadow 1")).passes
    ambient = np.array([0.1, 0.2, 0.3])
    full = -directions[:, 2:] * colours  # Ω of a white floor, (2,3)
    lit = ambient + S["Shadow 0"] * full[0] + S["Shadow 1"] * full[1]
    share = (lit / (ambient + full.sum(0))).mean(-1)
    expected = np.array([0.2, 0.4, 0.6]) * share[..., None]
    found = render_image(catching(scene), ("Combined",)).passes["Combined"]
    np.testing.assert_allclose(found[..., :3], expected, rtol=2e-6)
    assert (found[..., 3] == 1).all() and np.ptp(share) > 0.3
    clear = render_image(catching(scene, film_transparent=True))
    np.testing.assert_allclose(clear.passes["Combined"][..., 3], 1 - share, atol=1e-6)
    unlit = replace(scene, world_color=(0.0, 0.0, 0.0))  # no light is blue, so blue does not count
    clear = render_image(catching(unlit, film_transparent=True)).passes["Combined"]
    share = ((lit - ambient) / full.sum(0).clip(1e-9))[..., :2].mean(-1)
    np.testing.assert_allclose(clear[..., 3], 1 - share, atol=1e-6)


def test_in_a_mirror_a_catcher_is_an_object():
    parts = [Shape(rectangle((-3, -3), (3, 3), 0.0), Material("floor", Od=(0.9, 0.2, 0.1)), "floor"),
             Shape(rectangle((-3, -3), (3, 3), 4.0), MIRROR, "mirror")]
    scene = Scene.from_shapes(parts, Camera.look_at((0, -3, 1), (0, 0, 4), 30, 24, 24), [point((0, 0, 3))],
                              settings(mode="WHITTED"))
    np.testing.assert_array_equal(render_image(catching(scene)).passes["Combined"],
                                  render_image(scene).passes["Combined"])
    assert render_image(scene).passes["Combined"][..., 0].mean() > 0.1


def test_without_light_there_is_no_shadow():
    scene = with_lights(ball_on_a_mirror(ambient=0.0))
    found, expected = (render_image(s).passes["Combined"] for s in (
        catching(scene), flagged(scene, "floor", visible_camera=False)))
    np.testing.assert_array_equal(found, expected)


def test_catchers_of_coloured_glass_shadows_and_behind_each_other():
    """The first catcher on the way dims the background; a cut-out of one catches a part, and the next one the rest."""
    pane = Material("pane", kt=(0.9, 0.5, 0.1))
    parts = [Shape(rectangle((-5, -5), (0, 5), 3.0), pane, "pane", flags={"visible_camera": False})]
    parts += [Shape(rectangle((-5, -5), (5, 5), z), replace(GREY, name=f"{z}", alpha=alpha), "catcher",
                    flags={"shadow_catcher": True, "visible_shadow": False}) for z, alpha in ((0.0, 1.0), (1.0, 0.5))]
    scene = Scene.from_shapes(parts, look_down(0, 0, 2, 32), [sun((0, 0, -1))], settings(h=0.05), world_color=(1, 1, 1))
    picture = render_image(scene.with_settings(ambient=0.0)).passes["Combined"]
    np.testing.assert_allclose(picture[:, 2, :3], 0.5, rtol=1e-6)  # the mean of the pane's colour
    np.testing.assert_array_equal(picture[:, -2], 1)


def test_neither_is_planned_where_no_camera_sees_one():
    scene = tabletop(16)
    for hidden in (scene, flagged(scene, "bar", holdout=True, shadow_catcher=True, visible_camera=False)):
        assert not {"holdouts", "shadow catchers"} & set(render_image(hidden).statistics["plan"])
    seen = render_image(flagged(scene, "bar", shadow_catcher=True)).statistics["plan"]
    assert seen["shadow catchers"].startswith("1:")


def under_a_sky(*others, catchers=(), bounces=0, lamps=(), **values):
    """The alpha of the picture's middle: a catcher seen from above under a grey sky, and what else there is, which the
    camera does not see.
    """
    big, hidden = rectangle((-20.0, -20.0), (20.0, 20.0)), {"visible_camera": False}
    things = [Shape(big, GREY, "floor", flags={"shadow_catcher": True})]
    things += [Shape(mesh, material, name, (place,), hidden) for mesh, material, name, place in others]
    things += [Shape(big, GREY, "wall", (place,), {"shadow_catcher": True, **hidden}) for place in catchers]
    scene = Scene.from_shapes(things, look_down(0, 0, 0.2, 4), list(lamps), settings(
        world_light="SKY", film_transparent=True, bounces=bounces, **values), world_color=(0.5, 0.5, 0.5))
    return render_image(scene).passes["Combined"][..., 3]


DISC = cylinder(1, 1, 1.001, 128), replace(GREY, name="disc", Od=(0.0, 0.0, 0.0)), "disc", np.eye(4)


def test_a_catcher_has_the_shadow_of_the_sky():
    """Under a sky of one colour, alpha is the share of it that is hidden: here by a disc's view factor."""
    np.testing.assert_allclose(under_a_sky(DISC), 0.5, atol=0.015)  # 1² / (1² + 1²)
    assert not under_a_sky().any()


@pytest.mark.parametrize("bounces", [0, 1])
def test_catchers_are_compared_with_catchers_alone(bounces):
    """A wall that catches shadows, too, takes half of the sky and the sun, and casts no shadow on the floor. The disc
    hides a quarter of the whole sky behind the wall, and a quarter before it.
    """
    wall, lamp = translate(-0.2, 0, 0) @ rotate_y(np.pi / 2), [sun((0.6, 0, -0.8))]
    assert not under_a_sky(catchers=[wall], lamps=lamp, bounces=bounces).any()
    assert under_a_sky(DISC, catchers=[wall]).mean() == pytest.approx(0.5, abs=0.01)


def test_what_gives_light_darkens_no_catcher():
    """A lamp that is a surface adds light, if less than it hides. Without other light there is no shadow."""
    glow = replace(DISC[1], emission=(0.1, 0.1, 0.1))
    np.testing.assert_allclose(under_a_sky((DISC[0], glow, *DISC[2:])), 0.4, atol=0.015)
    bright = replace(glow, emission=(1.6, 0.0, 0.0))  # more of one colour counts for all
    assert not under_a_sky((DISC[0], bright, *DISC[2:])).any()
