"""Cells of a sheet as those of node_catalogue.py: images of several files, sequences, signed data, bumps of bumps,
profiles, and values that become another type on their way through groups; any bpy runs this.
"""

import itertools
import random
import tempfile
from pathlib import Path

import bpy
from node_catalogue import slope
from node_groups import group, used

NUMBERS = (1001, 1002, 1011)  # of the tiles that there are


def _saved(path, size, value, alpha=False):
    image = bpy.data.images.new(path.stem, size, size, alpha=True)
    chosen = random.Random(value)
    image.pixels.foreach_set([chosen.uniform(0.1, 0.9) if i % 4 < 3 or alpha else 1.0 for i in range(size * size * 4)])
    image.filepath_raw, image.file_format = str(path), 'PNG'
    image.save()
    bpy.data.images.remove(image)


def _tiles(pattern="<UDIM>", numbers=NUMBERS, alpha=False):
    """Return an image of UDIM tiles, in files of its own."""
    folder = Path(tempfile.mkdtemp())
    names = [pattern.replace("<UDIM>", str(n)).replace("<UVTILE>", f"u{(n - 1001) % 10 + 1}_v{(n - 1001) // 10 + 1}")
             for n in numbers]
    for name, number in zip(names, numbers, strict=True):
        _saved(folder / f"tile.{name}.png", 4, number, alpha)
    image = bpy.data.images.load(str(folder / f"tile.{names[0]}.png"))
    image.source, image.filepath = 'TILED', str(folder / f"tile.{pattern}.png")
    for number in numbers[1:]:
        image.tiles.new(number)
    return image


def _over(tree, scale=2.2, at=(-0.1, -0.1, 0.0)):
    """Return places on several tiles."""
    return tree.node('ShaderNodeMapping', {"Vector": tree.uv(), "Scale": (scale, scale, 1), "Location": at}).outputs[0]


def sources():
    """Cases of tiles, sequences, and data below 0."""
    def shown(image, output=0, place=_over, **properties):
        return lambda tree: tree.node('ShaderNodeTexImage', {0: place(tree)}, image=image(),
                                      **properties).outputs[output]

    def packed():
        image = _tiles()
        image.pack()
        return image

    def data():
        image = _tiles()
        image.colorspace_settings.name = "Non-Color"
        return image

    def signed(floats=True):
        image = bpy.data.images.new("signed", 5, 4, alpha=False, float_buffer=floats)
        image.colorspace_settings.name = "Non-Color"
        image.pixels.foreach_set([random.Random(i).uniform(-1.2, 1.5) if i % 4 < 3 else 1.0 for i in range(80)])
        image.pack()
        return image

    def sequence(cyclic, offset, start, duration, refresh):
        def made(tree):
            folder = Path(tempfile.mkdtemp())
            for n in range(1, 6):
                _saved(folder / f"frame.{n:03d}.png", 2, n)
            image = bpy.data.images.load(str(folder / "frame.001.png"))
            image.source = 'SEQUENCE'
            node = tree.node('ShaderNodeTexImage', {0: tree.uv()}, image=image)
            user = node.image_user
            user.use_cyclic, user.frame_offset, user.frame_start = cyclic, offset, start
            user.frame_duration, user.use_auto_refresh = duration, refresh
            return node.outputs[0]
        return made
    found = [(f"tiles {interpolation} {extension}", shown(_tiles, interpolation=interpolation, extension=extension))
             for interpolation in ('Linear', 'Closest', 'Cubic')
             for extension in ('REPEAT', 'EXTEND', 'CLIP', 'MIRROR')]
    found += [(f"tiles {kind}", shown(_tiles, projection=kind)) for kind in ('SPHERE', 'TUBE')]
    found += [
        ("tiles alpha", shown(lambda: _tiles(alpha=True), 1)), ("tiles colour", shown(lambda: _tiles(alpha=True))),
        ("tiles <UVTILE>", shown(lambda: _tiles("<UVTILE>"))), ("tiles packed", shown(packed)),
        ("tiles of data", shown(data)), ("signed data", shown(signed, place=lambda tree: tree.uv())),
        ("tiles from 1012", shown(lambda: _tiles(numbers=(1012, 1013, 1022)), place=lambda tree: _over(tree, 3.0))),
        ("tiles of two rows", shown(lambda: _tiles(numbers=(1010, 1011, 1020)),
                                    place=lambda tree: _over(tree, 3.0, (9, 0, 0))))]
    for how in itertools.product((False, True), (0, -1, 2), (1, -3, 3), (2, 5), (True,)):
        if 1 <= _frame(*how) <= 5:  # else there is no such file
            found.append((f"sequence {how}", sequence(*how)))
    return found


def _frame(cyclic, offset, start, duration, _):
    at = 1 - start + 1  # of frame 1, as Blender's manual has it
    if cyclic:
        at = (at - 1) % duration + 1
    return min(max(at, 0), duration) + offset


def conversions():
    """Cases of values that go through inputs and outputs of groups which have another type."""
    made_of = {'c': "Color", 'v': "Vector", 'f': "Float"}

    def through(kind, given, asked, side):
        def made(tree):
            parts = [slope(tree, 0.1, 2.4, j, False) for j in range(3)]
            source = tree.node('ShaderNodeCombineXYZ', dict(enumerate(parts))).outputs[0]
            if given == 'c':
                source = tree.node('ShaderNodeGamma', {"Color": source}).outputs[0]
            types = (kind, made_of[asked]) if side == "in" else (made_of[given], kind)
            inside, a, b = group("Through", [("A", types[0], None)], [("B", types[1], None)])
            inside.links.new(a.outputs[0], b.inputs[0])
            found = used(tree, inside, {"A": source}).outputs[0]
            if asked == 'f':
                return tree.node('ShaderNodeMath', {0: found, 1: 0.1}).outputs[0]
            return tree.node('ShaderNodeVectorMath', {0: found, 1: (0.1, 0.2, 0.3)}).outputs[0]
        return made

    def own_value(tree):
        """A colour that an inner group takes for a number, and uses as a colour."""
        inner, a, b = group("Inner", [("A", "Float", 0.3)], [("B", "Color", None)])
        inner.links.new(a.outputs[0], b.inputs[0])
        outer, c, d = group("Outer", [("C", "Color", (0.9, 0.4, 0.1, 1))], [("D", "Color", None)])
        node = outer.nodes.new('ShaderNodeGroup')
        node.node_tree = inner
        outer.links.new(c.outputs[0], node.inputs[0])
        outer.links.new(node.outputs[0], d.inputs[0])
        return used(tree, outer).outputs[0]
    found = [(f"{given} as {kind}, {side}, for {asked}", through(kind, given, asked, side))
             for kind in ("Float", "Color", "Vector", "Int", "Bool") for given in 'cv' for asked in 'cfv'
             for side in ("in", "out")]
    return [*found, ("a group's own colour as a number", own_value)]


def bent():
    """Cases of normals that bumps and maps bend one after the other."""
    def noise(tree):
        return tree.node('ShaderNodeTexNoise', {"Vector": tree.uv(), "Scale": 2.0, "Detail": 1.0}).outputs[0]

    def bump(tree, normal=None, **properties):
        return tree.node('ShaderNodeBump', {"Height": noise(tree), "Distance": 0.3}
                         | ({"Normal": normal} if normal else {}), **properties).outputs[0]

    def mapped(tree, space, uv_map=""):
        parts = [slope(tree, *ends, j, False) for j, ends in enumerate(((0.2, 0.8), (0.3, 0.7), (0.6, 1.0)))]
        color = tree.node('ShaderNodeCombineXYZ', dict(enumerate(parts))).outputs[0]
        return tree.node('ShaderNodeNormalMap', {"Color": color, "Strength": 0.7}, space=space,
                         uv_map=uv_map).outputs[0]
    spaces = ('TANGENT', 'OBJECT', 'WORLD', 'BLENDER_OBJECT', 'BLENDER_WORLD')
    found = [(f"bump of a map in {space}", lambda tree, space=space: bump(tree, mapped(tree, space)))
             for space in spaces]
    return [*found, ("bump of a bump", lambda tree: bump(tree, bump(tree))),
            ("bump of an inverted one", lambda tree: bump(tree, bump(tree, invert=True))),
            ("bump of a bump of a map", lambda tree: bump(tree, bump(tree, mapped(tree, 'TANGENT')))),
            ("map by a UV map that no mesh has", lambda tree: mapped(tree, 'TANGENT', "none"))]


PROFILE = """IESNA:LM-63-1995
TILT=NONE
1 -1 1 5 3 1 2 0 0 0
1 1 100
0 45 90 135 180
0 90 180
400 350 200 90 10
300 500 100 50 20
250 150 80 20 0
"""


def profiles():
    """Cases of what else is made for lamps: a luminaire's light by direction, and falloff that no distance changes."""
    def light(place=None, text=PROFILE):
        def made(tree):
            node = tree.node('ShaderNodeTexIES', {"Strength": 0.05 if text else 0.01} | (
                {"Vector": place(tree)} if place else {}))
            if text:
                node.ies = bpy.data.texts.new("lamp.ies")
                node.ies.write(text)
            return node.outputs[0]
        return made

    def around(tree):
        return tree.node('ShaderNodeVectorMath', {0: tree.uv(), 1: (0.5, 0.5, 0.3)}, operation='SUBTRACT').outputs[0]
    found = [("IES", light()), ("IES without a file", light(text="")),
             ("quadratic falloff", lambda tree: tree.node('ShaderNodeLightFalloff', {"Strength": 1.5}).outputs[0])]
    if bpy.app.version >= (5, 0):  # before, Cycles is up to 8 % brighter from 90 to 270 degrees: materials.md
        found.append(("IES by a direction", light(around)))
    return found


SHEETS = {"sources": lambda: sources() + conversions() + bent() + profiles()}
