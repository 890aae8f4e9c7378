"""The energy of lights is that of Cycles: the same .blend, sharp shadows, direct light only, in both engines."""

import importlib.util
import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from cycles_pictures import CASES, LENSES, PANES

pytestmark = [pytest.mark.slow,
              pytest.mark.skipif(not importlib.util.find_spec("bpy"), reason="bpy is not installed")]
HERE = Path(__file__).parent
LIGHTS = HERE.parents[1] / "blend_scenes" / "lights.blend"


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """case → (ours, Cycles'), or why not."""
    folder = tmp_path_factory.mktemp("cycles")
    run = subprocess.run([sys.executable, HERE / "cycles_pictures.py", LIGHTS, folder],
                         capture_output=True, text=True, timeout=400)
    assert (folder / "cases.json").exists(), run.stdout[-3000:] + run.stderr[-3000:]
    why = json.loads((folder / "cases.json").read_text())

    @cache
    def case(name):
        if why.get(name):
            pytest.skip(why[name])
        return tuple(read(folder / f"{name}.{kind}.exr") for kind in ("ours", "cycles"))
    return case


def read(path):
    return oiio.ImageInput.open(str(path)).read_image(oiio.FLOAT)[..., :3].astype(float)


def smooth(picture, least=0.2):
    """Pixels two or more away from any edge of a face or a shadow: where the light changes by a fifth at once."""
    light = picture.max(-1)
    edge = np.zeros(light.shape, bool)
    for axis in (0, 1):
        a, b = (np.take(light, range(k, light.shape[axis] - 1 + k), axis) for k in (0, 1))
        jump = np.abs(a - b) > least * np.maximum(np.maximum(a, b), 1e-6)
        edge |= np.pad(jump, [(0, int(i == axis)) for i in (0, 1)])
        edge |= np.pad(jump, [(int(i == axis), 0) for i in (0, 1)])
    for _ in range(2):
        grown = edge.copy()
        for axis in (0, 1):
            grown |= np.roll(edge, 1, axis) | np.roll(edge, -1, axis)
        edge = grown
    return ~edge


@pytest.mark.parametrize("name", CASES)
def test_lit_surfaces_have_cycles_radiance(pictures, name):
    ours, cycles = pictures(name)
    compared = smooth(cycles) & (cycles.max(-1) > 0)
    assert compared.mean() > 0.1
    assert cycles[compared].max() > 0.05
    difference = np.abs(ours - cycles)[compared] / cycles[compared].clip(1e-12)
    assert np.median(difference) <= 0.005
    assert np.quantile(difference, 0.99) <= 0.02


@pytest.mark.parametrize("name", CASES)
def test_shadows_lie_where_cycles_has_them(pictures, name):
    """Away from edges a pixel is black in both pictures or in neither."""
    ours, cycles = pictures(name)
    compared = smooth(cycles)
    black = (cycles.max(-1) == 0)
    assert 0.02 < black[compared].mean() < 0.98
    assert ((ours.max(-1) == 0) == black)[compared].mean() > 0.999


@pytest.mark.parametrize("name", PANES)
def test_straight_shadows_through_glass_are_cycles_transparent_shadows(pictures, name):
    """M1: Π t of a thin box and of a column, in view and in their shadows."""
    ours, cycles = pictures(name)
    compared = smooth(cycles, 0.1) & (cycles.max(-1) > 0)  # edges seen through glass are faint
    assert compared.mean() > 0.5
    difference = np.abs(ours - cycles)[compared] / cycles[compared].clip(1e-12)
    assert np.median(difference) <= 0.005
    assert np.quantile(difference, 0.99) <= 0.01


def test_the_pixel_filter_is_as_wide_as_cycles(pictures):
    """Blender's filter size means the same blur of an edge: the same variance, from the edge's profile."""
    x, y = np.meshgrid(np.arange(32) - 15.5, 15.5 - np.arange(32))
    distance = (x - y / 32).ravel()
    order = np.argsort(distance)
    middle = (distance[order][1:] + distance[order][:-1]) / 2
    widths = []
    for picture in pictures("edge"):
        step = np.diff(picture[..., 0].ravel()[order])
        assert abs((step * middle).sum()) < 0.02
        widths.append(np.sqrt((step * middle**2).sum()))
    assert widths[0] == pytest.approx(widths[1], rel=0.05)


@pytest.mark.parametrize("name", LENSES)
def test_what_is_out_of_focus_is_cycles_blur(pictures, name):
    """A dot becomes the lens: where it lies, its size along and across, and which way its corners point."""
    found = []
    for picture in pictures(f"lens, {name}"):
        light = picture[..., 0] / picture[..., 0].sum()
        y, x = np.indices(light.shape)
        centre = np.array([(light * x).sum(), (light * y).sum()])
        x, y = x - centre[0], y - centre[1]
        variance = [(light * x**2).sum(), (light * y**2).sum(), (light * x * y).sum()]
        skew = [(light * x**(3 - k) * y**k).sum() for k in range(4)]
        found.append((picture[..., 0].sum(), centre, variance, skew))
    (energy, centre, variance, skew), cycles = found
    size = np.mean(cycles[2][:2])
    assert 4 < size < 40
    assert energy == pytest.approx(cycles[0], rel=0.02)
    assert centre == pytest.approx(cycles[1], abs=0.1)
    assert variance == pytest.approx(cycles[2], abs=0.02 * size)
    assert skew == pytest.approx(cycles[3], abs=0.04 * size**1.5)
