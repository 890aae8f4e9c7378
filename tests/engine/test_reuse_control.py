"""Data kept from one picture to the next if shadows are controlled: casters, receivers, links and radii."""

from dataclasses import replace

import numpy as np
import pytest
from kept import after, moved, room, with_light, with_material, with_object


def test_soft_and_sharp_casters_and_receivers():
    first = room()
    sharp = with_object(first, 1, cast_soft_shadows=False)
    for one, other in ((first, sharp), (sharp, first)):
        kept, fresh, *_ = after(one, other)
        assert 0 < kept["long_rays"] < 0.5 * fresh["long_rays"]
    kept, *_ = after(first, with_object(first, 0, receive_soft_shadows=False))
    assert kept["long_rays"] == 0
    all_sharp = with_material(first, 0, cast_soft_shadows=False)
    for one, other in ((first, all_sharp), (all_sharp, first)):
        after(one, other)


def test_what_lights_are_linked_with():
    first = room()
    linked = with_light(first, 0, blockers=(1,))
    for one, other in ((first, linked), (linked, first), (linked, with_light(first, 0, blockers=(2,)))):
        kept, fresh, *_ = after(one, other)
        assert 0 < kept["long_rays"] < fresh["long_rays"]
    kept, *_ = after(first, with_light(first, 0, receivers=(0,)))
    assert kept["long_rays"] == 0
    after(linked, moved(linked, 1, (0.3, 0.1, 0.0)))


@pytest.mark.parametrize("change", [{"softness": "RADIUS", "soft_radius": 0.15},
                                    {"softness": "LIGHT_SIZE", "radius": 0.2}])
def test_a_light_of_another_softness_has_the_same_column(change):
    first = room(weights="SMOOTH")
    kept, fresh, *_ = after(first, with_light(first, 0, **change))
    assert kept["nodes_kept"] > 0 and kept["long_rays"] < 0.8 * fresh["long_rays"]


def test_the_order_of_the_objects_says_nothing():
    first = room()
    g = first.geometry
    turned = replace(first, objects=first.objects[::-1], geometry=replace(
        g, instance_mesh=g.instance_mesh[::-1].copy(), instance_object=g.instance_object.copy(),
        instance_matrix=g.instance_matrix[::-1].copy()))
    kept, *_ = after(first, turned)
    assert kept["long_rays"] == 0


def test_an_edited_mesh_is_a_moved_object():
    first = room()
    vertices = first.geometry.vertices.copy()
    v0, nv = first.geometry.meshes[2, :2]
    vertices[v0 + nv - 1] -= np.float32(0.2)  # the scene's bounds stay
    kept, fresh, *_ = after(first, replace(first, geometry=replace(first.geometry, vertices=vertices)))
    assert 0 < kept["long_rays"] < 0.5 * fresh["long_rays"]


def test_renamed_objects_are_named_in_the_warnings():
    first = room()
    vertices = first.geometry.vertices.copy()
    vertices[first.geometry.meshes[1, 0]] = np.nan
    first = replace(first, geometry=replace(first.geometry, vertices=vertices))
    after(first, with_object(first, 1, name="another"))
