"""The Voronoi texture beside Cycles: all features, metrics, dimensions and outputs."""

import pytest
from node_pictures import check
from node_trees import FEATURES, Tree, voronoi

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("dimensions", ['1D', '2D', '3D', '4D'])
def test_features(plane, scene, render, dimensions, feature):
    tree = Tree()
    check(plane, scene, render, voronoi(tree, dimensions, feature), tree)


@pytest.mark.parametrize("distance", ['MANHATTAN', 'CHEBYCHEV', 'MINKOWSKI'])
@pytest.mark.parametrize(("dimensions", "feature"), [('2D', 'F2'), ('3D', 'F1'), ('4D', 'SMOOTH_F1')])
def test_distances(plane, scene, render, dimensions, feature, distance):
    tree = Tree()
    check(plane, scene, render, voronoi(tree, dimensions, feature, distance=distance), tree)


@pytest.mark.parametrize("normalize", [False, True])
@pytest.mark.parametrize(("dimensions", "feature"), [('1D', 'F1'), ('2D', 'SMOOTH_F1'), ('3D', 'F2'),
                                                     ('3D', 'DISTANCE_TO_EDGE')])
def test_octaves(plane, scene, render, dimensions, feature, normalize):
    tree = Tree()
    inputs = {"Scale": 1.2, "Detail": 1.6, "Roughness": 0.6, "Lacunarity": 2.1}
    check(plane, scene, render, voronoi(tree, dimensions, feature, inputs, normalize=normalize), tree)
