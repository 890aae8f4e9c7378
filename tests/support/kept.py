"""Draw two pictures in sequence: `first`, and then `second` with everything of the first that is still valid."""

from dataclasses import replace

import numpy as np
from light_meshes import Camera, Scene, Shape, box, rectangle, translate
from light_meshes.film.images import Framebuffer
from light_meshes.picture.render import draw, prepare, render_image
from scenes import GREY, point, settings, sun, with_lights

PASSES = ("Combined", "Depth", "Normal", "Shadow")
WIDTH = 48


def drawn(scene: Scene, previous=None, passes=PASSES):
    """Return a picture and what was prepared for it."""
    ready = prepare(scene, passes, previous=previous)
    return draw(ready, Framebuffer.create(ready.scene, passes)), ready


def after(first: Scene, second: Scene):
    """Draw `second` after `first`, and check that it has the same bits as a picture from scratch. Returns the figures
    of both ways.
    """
    _, ready = drawn(first)
    kept, then = drawn(second, ready)
    fresh = render_image(second, PASSES)
    for name in PASSES:
        np.testing.assert_array_equal(kept.passes[name], fresh.passes[name], err_msg=name)
    assert kept.warnings == fresh.warnings
    for name in ("camera_rays", "secondary_rays", "plan", "h"):
        assert kept.statistics.get(name) == fresh.statistics.get(name)
    return kept.statistics, fresh.statistics, ready, then


def with_camera(scene: Scene, eye, target=(0, 0, 0.4), degrees=40) -> Scene:
    return replace(scene, camera=Camera.look_at(eye, target, degrees, WIDTH, WIDTH))


def with_material(scene: Scene, i: int, **values) -> Scene:
    materials = list(scene.materials)
    materials[i] = replace(materials[i], **values)
    return replace(scene, materials=tuple(materials))


def with_light(scene: Scene, i: int, **values) -> Scene:
    lights = list(scene.lights)
    lights[i] = replace(lights[i], **values)
    return with_lights(scene, *lights)


def with_object(scene: Scene, i: int, **values) -> Scene:
    objects = list(scene.objects)
    objects[i] = replace(objects[i], **values)
    return replace(scene, objects=tuple(objects))


def moved(scene: Scene, instance: int, by) -> Scene:
    matrices = scene.geometry.instance_matrix.copy()
    matrices[instance] = translate(*by) @ matrices[instance]
    return replace(scene, geometry=replace(scene.geometry, instance_matrix=matrices))


def room(*more: Shape, **values) -> Scene:
    """Return a floor with two boxes far apart, which keep their places whatever stands between them."""
    parts = [Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor"),
             Shape(box((-2.4, -0.4, 0.0), (-1.8, 0.2, 1.0)), GREY, "left"),
             Shape(box((1.8, -0.4, 0.0), (2.4, 0.2, 1.0)), GREY, "right"), *more]
    lights = [point((-2.0, -2.0, 4.0), name="a"), point((2.0, -2.0, 4.0), name="b"), sun((0.3, 0.2, -1.0), 0.5)]
    return Scene.from_shapes(parts, Camera.look_at((0, -7, 5), (0, 0, 0), 40, WIDTH, WIDTH), lights,
                             settings(**({"h": 0.1} | values)))
