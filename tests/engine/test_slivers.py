"""Triangles that make tracing slow are found before the render and named, and the picture is still made."""

import numpy as np
import pytest
from light_meshes import Camera, Mesh, Scene, Shape, cylinder, rectangle, rotate_z, sphere
from light_meshes.picture.render import render_image
from light_meshes.rays.geometry import flatten
from scenes import GREY, hall, point, settings, tabletop


def strips(count: int, length: float = 2.0, width: float = 1e-4) -> Mesh:
    """Long thin triangles in all directions."""
    random = np.random.default_rng(0)
    a, way, across = random.uniform(-1, 1, (count, 3)), random.normal(size=(count, 3)), random.normal(size=(count, 3))
    way *= length / np.linalg.norm(way, axis=1, keepdims=True)
    across *= width / np.linalg.norm(across, axis=1, keepdims=True)
    return Mesh(np.concatenate([a - way / 2, a + way / 2, a + way / 2 + across]), np.arange(3 * count).reshape(3, -1).T)


def with_floor(*parts: Shape):
    return Scene.from_shapes([Shape(rectangle((-2, -2), (2, 2), -1.0), GREY, "floor"), *parts],
                             Camera.look_at((3, -4, 3), (0, 0, 0), 45, 24, 24), [point((1, -2, 4))], settings(h=0.1))


def test_an_object_of_slivers_is_named_and_rendered():
    few = Shape(strips(20), GREY, "a few straws")
    result = render_image(with_floor(few, Shape(strips(8000), GREY, "hay")))
    assert np.isfinite(result.passes["Combined"]).all()
    (sentence,) = result.warnings
    assert "'hay': 8,000 of its triangles are long, thin and slanted" in sentence
    assert not render_image(with_floor(few)).warnings
    ground = Shape(rectangle((-900, -900), (900, 900), -1.0), GREY, "ground")
    assert flatten(with_floor(Shape(strips(8000), GREY, "hay"), ground))[1] == [sentence]  # though most rays miss it


def test_the_number_is_that_of_boxes_on_a_rays_way():
    """Lines of all directions and places, against the boxes one by one."""
    scene = with_floor(Shape(strips(8000), GREY, "hay"))
    surfaces, (sentence,) = flatten(scene)
    said = float(sentence.split("about ")[1].split(" ")[0].replace(",", ""))
    corners = surfaces.vertices[surfaces.triangles[surfaces.instance == 1]].astype(float)
    low, high = corners.min(1), corners.max(1)
    random = np.random.default_rng(1)
    d, o = random.normal(size=(4000, 3)), random.normal(size=(4000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    o -= (o * d).sum(1, keepdims=True) * d
    reach = np.linalg.norm(high.max(0) - low.min(0)) / 2  # even in a disc that covers the object
    o *= reach * np.sqrt(random.uniform(size=(4000, 1))) / np.linalg.norm(o, axis=1, keepdims=True)
    o += (low.min(0) + high.max(0)) / 2

    def pierced(low, high, k):
        t = np.stack([(low - o[k]) / d[k], (high - o[k]) / d[k]])
        return t.min(0).max(-1) < t.max(0).min(-1)

    counts = [pierced(low, high, k).sum() for k in range(len(o)) if pierced(low.min(0), high.max(0), k)]
    assert len(counts) > 500
    assert said == pytest.approx(np.mean(counts), rel=0.1)


@pytest.mark.parametrize("scene", [
    tabletop(8), hall(4, columns=3, sides=24, width=8), with_floor(Shape(sphere(1, 300, 150), GREY, "ball")),
    with_floor(Shape(cylinder(0.5, -1, 1, 3000), GREY, "upright", [rotate_z(0.3)])),
    with_floor(Shape(strips(300), GREY, "straw")), with_floor(Shape(strips(20000, 0.05, 0.005), GREY, "chaff")),
], ids=["table", "hall", "ball", "upright cylinder", "a little straw", "chaff"])
def test_usual_scenes_are_not_blamed(scene):
    assert not flatten(scene)[1]
