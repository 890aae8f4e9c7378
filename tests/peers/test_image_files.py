"""Files of every kind that Blender opens, as Cycles shows them between texels: colour, and alpha."""

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest
from node_pictures import both
from node_trees import Tree, sheet

pytestmark = pytest.mark.slow
CELL = 20
# Name, channels, kind of numbers, names of channels.
FILES = [
    *((f"{ext}-{channels}-{kind}.{ext}", channels, kind, None) for ext in ("png", "tif") for channels in (1, 3, 4)
      for kind in ("uint8", "uint16")),
    ("grey.tif", 2, "uint8", None), ("floats.tif", 4, "float", None), ("picture.jpg", 3, "uint8", None),
    ("picture.bmp", 4, "uint8", None), ("picture.tga", 4, "uint8", None), ("picture.webp", 4, "uint8", None),
    ("picture.hdr", 3, "float", None), ("picture.ppm", 3, "uint8", None), ("five.tif", 5, "uint8", None),
    *((f"half-{names}.exr", len(names), "half", names) for names in ("Y", "YA", "RGB", "RGBA", "BGR", "XYZ")),
    ("depth.exr", 5, "float", "RGBAZ"), ("two.exr", 6, "float", ("a.R", "a.G", "a.B", "b.R", "b.G", "b.B")),
    ("signed.exr", 3, "float", "RGB")]


def saved(folder, name, channels, kind, names):
    """Write a picture of 8 × 6 texels, with an alpha that goes from .2 to 1 if it has one."""
    pixels = np.random.default_rng(len(name)).uniform(0.15, 0.85, (6, 8, channels)).astype(np.float32)
    if channels in (2, 4):
        pixels[..., -1] = np.linspace(0.2, 1, 8)
    if name == "signed.exr":
        pixels = pixels * 3 - 1.5
    spec = oiio.ImageSpec(8, 6, channels, kind)
    if names:
        spec.channelnames = tuple(names)
    elif channels in (2, 4):
        spec.alpha_channel = channels - 1
    if name.endswith("webp"):
        spec.attribute("compression", "lossless")
    out = oiio.ImageOutput.create(str(folder / name))
    assert out.open(str(folder / name), spec) and out.write_image(pixels) and out.close(), out.geterror()
    return folder / name


def cases(folder):
    """Yield what is shown, and its tree with the socket that shows it."""
    for file in FILES:
        path = saved(folder, *file)
        for output in ("Color", "Alpha", "both"):
            tree = Tree()
            node = tree.node('ShaderNodeTexImage', {0: tree.uv()}, image=bpy.data.images.load(str(path)))
            socket = tree.node('ShaderNodeVectorMath', {0: node.outputs[0], 1: node.outputs[1]}, operation='ADD'
                               ).outputs[0] if output == "both" else node.outputs[output]
            yield f"{path.name} {output}", tree, socket


def test_files(scene, render, tmp_path):
    found = list(cases(tmp_path))
    columns = sheet(scene, [case[1:] for case in found], CELL)
    ours, theirs = ((picture - 0.5) / 0.2 for picture in both(scene, render))
    wrong = []
    for i, (label, *_) in enumerate(found):
        y, x = CELL * (i // columns), CELL * (i % columns)
        a, b = (picture[y:y + CELL, x:x + CELL] for picture in (ours, theirs))
        difference = np.abs(a - b).max(2) / np.maximum(np.abs(b).max(2), 0.1)
        if not (np.median(difference) <= 0.005 and np.quantile(difference, 0.99) <= 0.03):
            wrong.append(f"{label}: {np.median(difference):.4f}, {np.quantile(difference, 0.99):.4f}")
    assert not wrong, "\n".join(wrong)
