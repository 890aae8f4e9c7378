"""A stage before the show: 300 spots on six bars, each with a gobo and the distribution of an IES file."""

from math import pi, radians

import bpy
import numpy as np
from common import (
    add,
    ball,
    box,
    cloth,
    flight,
    grid,
    image,
    lathe,
    mesh,
    noise,
    principled,
    save,
    start,
    textured,
    towards,
    tube,
    unwrap,
    wood,
    world,
)

BARS, ON_A_BAR = 6, 50  # 300 spots
COLORS = ((1.0, 0.18, 0.08), (0.12, 0.3, 1.0), (1.0, 0.62, 0.2), (0.75, 0.1, 0.9), (0.1, 0.85, 0.8), (1.0, 0.85, 0.65))


def gobos(size=128):
    """Return pictures that stand in the light: spokes, dots, bars, leaves."""
    y, x = np.meshgrid(*[np.linspace(-1, 1, size)] * 2, indexing="ij")
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    masks = (
        np.sin(8 * angle) > -0.2,
        np.hypot((4 * x) % 1 - 0.5, (4 * y) % 1 - 0.5) < 0.36,
        np.sin(14 * x) > -0.3,
        noise(size, 6, 17) > 0.45,
    )
    return [
        image(f"Gobo {n}", np.repeat((mask & (radius < 0.95)).astype(float)[..., None], 3, 2), data=True)
        for n, mask in enumerate(masks)
    ]


def ies(power):
    """Return an IES file of a narrow beam, cos^power: intensities at vertical angles of 0° to 90°."""
    angles = np.arange(0, 91, 5)
    values = 60 * np.cos(np.radians(angles)) ** power
    text = bpy.data.texts.new(f"beam {power}.ies")
    text.write(
        "IESNA:LM-63-1995\n[TEST] made by script\nTILT=NONE\n"
        f"1 1000 1 {len(angles)} 1 1 2 -0.1 0 0\n1 1 100\n"
        + " ".join(map(str, angles))
        + "\n0\n"
        + " ".join(f"{v:.1f}" for v in values)
        + "\n"
    )
    return text


def fixture(name, color, gobo, text, energy):
    """Return a spot whose nodes project a gobo, with the strength of an IES file by direction."""
    data = bpy.data.lights.new(name, 'SPOT')
    data.energy, data.color = energy, color
    data.spot_size, data.spot_blend, data.shadow_soft_size = radians(15), 0.15, 0.04
    data.light_meshes.softness = 'SIZE'
    data.use_nodes = True
    nodes, links = data.node_tree.nodes, data.node_tree.links
    shine = nodes["Emission"]
    way, parts = nodes.new('ShaderNodeTexCoord'), nodes.new('ShaderNodeSeparateXYZ')
    links.new(way.outputs["Normal"], parts.inputs[0])
    flat = nodes.new('ShaderNodeCombineXYZ')
    for n, axis in enumerate("XY"):  # on a plane before the lamp: .5 − .5·x/(z·tan)
        divide, shift = nodes.new('ShaderNodeMath'), nodes.new('ShaderNodeMath')
        divide.operation, shift.operation = 'DIVIDE', 'MULTIPLY_ADD'
        links.new(parts.outputs[axis], divide.inputs[0])
        links.new(parts.outputs["Z"], divide.inputs[1])
        links.new(divide.outputs[0], shift.inputs[0])
        shift.inputs[1].default_value, shift.inputs[2].default_value = 0.5 / np.tan(radians(7.5)), 0.5
        links.new(shift.outputs[0], flat.inputs[n])
    picture = nodes.new('ShaderNodeTexImage')
    picture.image, picture.extension = gobo, 'CLIP'
    links.new(flat.outputs[0], picture.inputs["Vector"])
    links.new(picture.outputs["Color"], shine.inputs["Color"])
    beam = nodes.new('ShaderNodeTexIES')
    beam.mode, beam.ies = 'INTERNAL', text
    beam.inputs["Strength"].default_value = 1.0
    links.new(beam.outputs["Fac"], shine.inputs["Strength"])
    return data


def spots():
    masks, files = gobos(), [ies(8), ies(30)]
    kinds = [fixture(f"Fixture {n}", COLORS[n % 6], masks[n % 4], files[n // 6 % 2], 3500) for n in range(24)]
    black = principled("Fixture", (0.02, 0.02, 0.02), Roughness=0.5)
    # The lens looks down its −z, 2 cm before the housing.
    housing = lathe("Housing", [(0, 0.02), (0.08, 0.02), (0.1, 0.2), (0, 0.26)], 16, black, smooth="sides")
    random = np.random.default_rng(12)
    for bar in range(BARS):
        y, z = 1.5 + 1.3 * bar, 6.3 + 0.12 * bar
        for height in (0, 0.35):
            add(f"Truss.{bar}.{height}", tube("Truss", [(-7, 0, 0), (7, 0, 0)], 0.03, black), (0, y, z + 0.28 + height))
        for k in range(ON_A_BAR):
            x = -6.6 + 13.2 * k / (ON_A_BAR - 1)
            target = (
                0.75 * x + random.uniform(-2.2, 2.2),
                y + random.uniform(-2.0, 3.2),
                random.choice([0, 0, 0, 1.2]),
            )
            spot = add(f"Spot.{bar}.{k:02}", kinds[(bar * 5 + k * 7) % len(kinds)], (x, y, z))
            spot.rotation_euler = towards((x, y, z), target)
            add(f"Housing.{bar}.{k:02}", housing, (x, y, z), spot.rotation_euler)


def stage():
    boards = textured("Boards", wood("Boards", (0.05, 0.045, 0.04), (0.16, 0.14, 0.12), 10), Roughness=0.3)
    add("Stage", unwrap(box("Stage", (-8, -1, -0.9), (8, 10, 0), boards), 2.5))
    curtain = grid(
        "Curtain",
        np.linspace(-8, 8, 500),
        np.linspace(0, 7.5, 4),
        lambda x, y: 0.14 * np.sin(9 * x + 0.8 * np.sin(2.1 * x)),
        textured("Velvet", cloth("Velvet", (0.34, 0.3, 0.3), (0.3, 0.27, 0.27)), Roughness=1.0),
    )
    add("Curtain", curtain, (0, 9.6, 0), (pi / 2, 0, 0))
    riser = principled("Riser", (0.1, 0.1, 0.11), Roughness=0.5)
    for n, (low, high) in enumerate(
        (((-2, 5.2, 0), (2, 7.8, 0.6)), ((-6.2, 4.4, 0), (-3.4, 6.4, 0.4)), ((3.4, 4.4, 0), (6.2, 6.4, 0.4)))
    ):
        add(f"Riser.{n}", box(f"Riser.{n}", low, high, riser))


def band():
    """The band: its drums, six musicians, a microphone, and the loudspeakers."""
    chrome = principled("Chrome", (0.8, 0.8, 0.82), Metallic=1.0, Roughness=0.12)
    drums(chrome)
    musicians()
    add("Mic Stand", tube("Mic Stand", [(0, 0, 0), (0, 0, 1.5), (0, 0.1, 1.56)], 0.012, chrome), (0, 2.2, 0))
    add("Mic", ball("Mic", 0.035, chrome), (0, 2.32, 1.58))
    speakers()


def drums(chrome):
    """Five drums and three cymbals on stands."""
    shell = principled("Drum Shell", (0.5, 0.03, 0.04), Roughness=0.2)
    skin = principled("Skin", (0.8, 0.78, 0.72), Roughness=0.6)
    for n, (x, y, z, r, h) in enumerate(
        (
            (0, 6.2, 0.62, 0.3, 0.42),
            (-0.45, 6.0, 1.15, 0.17, 0.2),
            (0.4, 6.0, 1.15, 0.17, 0.2),
            (-0.85, 6.3, 0.95, 0.18, 0.15),
            (0.85, 6.4, 0.62, 0.22, 0.45),
        )
    ):
        add(f"Drum.{n}", lathe(f"Drum.{n}", [(0, 0), (r, 0), (r, h), (0, h)], 48, shell, smooth="sides"), (x, y, z))
        add(
            f"Head.{n}",
            lathe(f"Head.{n}", [(0, h + 0.002), (0.98 * r, h + 0.002), (0, h + 0.004)], 48, skin),
            (x, y, z),
        )
    for n, (x, y) in enumerate(((-1.1, 6.0), (1.1, 6.1), (-0.2, 6.7))):
        add(f"Stand.{n}", tube(f"Stand.{n}", [(0, 0, 0.6), (0, 0, 1.75)], 0.012, chrome), (x, y, 0))
        add(
            f"Cymbal.{n}",
            lathe(
                f"Cymbal.{n}",
                [(0, 0.05), (0.05, 0.03), (0.25, 0), (0.05, 0.028), (0, 0.045)],
                48,
                principled("Cymbal", (0.8, 0.6, 0.25), Metallic=1.0, Roughness=0.2),
            ),
            (x, y, 1.75),
            (0.2, 0.1 * n, 0),
        )


def musicians():
    """Figures of turned wood."""
    body = [
        (0, 0),
        (0.13, 0),
        (0.11, 0.45),
        (0.17, 0.85),
        (0.16, 1.05),
        (0.22, 1.35),
        (0.17, 1.46),
        (0.07, 1.5),
        (0.07, 1.55),
        (0.1, 1.6),
        (0.11, 1.68),
        (0.08, 1.77),
        (0, 1.8),
    ]
    for n, (x, y, z, color) in enumerate(
        (
            (0, 2.6, 0, (0.75, 0.72, 0.7)),
            (-2.6, 3.4, 0, (0.35, 0.35, 0.4)),
            (2.7, 3.3, 0, (0.5, 0.4, 0.3)),
            (-4.8, 5.2, 0.4, (0.5, 0.5, 0.55)),
            (4.8, 5.2, 0.4, (0.6, 0.55, 0.5)),
            (0, 7.1, 0.6, (0.4, 0.4, 0.4)),
        )
    ):
        add(
            f"Musician.{n}",
            lathe(f"Musician.{n}", body, 40, principled(f"Clothes {n}", color, Roughness=0.8)),
            (x, y, z),
            (0, 0, n),
            (1, 0.65, 1),
        )


def speakers():
    """Three loudspeakers on each side, and monitors on the floor."""
    black = principled("Speaker", (0.03, 0.03, 0.03), Roughness=0.6)
    for x in (-7.1, 7.1):
        for k in range(3):
            add(f"Speaker.{x}.{k}", box("Speaker", (-0.5, -0.4, 0), (0.5, 0.4, 0.95), black), (x, 1.2, 0.97 * k))
    for n, x in enumerate((-2.4, 0, 2.4)):
        wedge = [(-0.3, 0, 0), (0.3, 0, 0), (0.3, 0.4, 0), (-0.3, 0.4, 0), (-0.3, 0, 0.3), (0.3, 0, 0.3)]
        add(
            f"Monitor.{n}",
            mesh(f"Monitor.{n}", wedge, [(0, 3, 2, 1), (0, 1, 5, 4), (1, 2, 5), (0, 4, 3), (2, 3, 4, 5)], black),
            (x, 0.6, 0),
        )


def make(folder):
    start(exposure=0.0)
    bpy.context.scene.light_meshes.light_threshold = 0.01  # as Cycles' own
    world((0, 0, 0), 0.0)
    stage()
    band()
    spots()
    flight((-2.4, -8.6, 2.4), (-0.6, -8.8, 2.3), (-0.1, 4, 2.1), (0, 4, 2.1), 26)
    save("stage", folder)
