"""Measure what the plan saves: take each decision, force it the other way, and check that the picture has the same bits
(method §5).

"Ambient light" is not measured: it costs three products for each hit, and no other way would be cheaper. "Soft lights"
is not measured either: nothing can force columns in the nodes that are not needed.

A decision that depends on a flag of the plan is forced by this flag. A decision that depends on the data of the scene
is forced by an equivalent scene with other data: for example one in which a triangle exists twice for one kind of ray,
or one with a light that is too dark for float32.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from statistics import median
from typing import Any

import numpy as np

from ..picture.plan import forced
from ..picture.render import render_image
from ..scene.description import Scene
from .measure import PREPARING, Say

DARK = 1e-300  # an intensity above 0 that adds nothing in float32
PREPARED = ("accelerators", "casters")  # decisions whose cost is in the preparing
# Visible only in mirrors, of which the scene has none. (What no ray at all can hit is left out of the surfaces.)
SHARP_TWIN = ({"receive_soft_shadows": False, "visible_reflection": True},)
SEEN_BY_ONE = ({"visible_camera": True}, {"visible_shadow": True})


@dataclass(frozen=True)
class Decision:
    """One row of the table."""

    plan: str  # its name in the plan
    what: str
    taken: Scene  # a scene in which the plan takes the cheap way
    other: Scene | None  # a scene in which it does not; None if no scene of the benchmark needs it
    forced: dict[str, Any] = field(default_factory=dict)  # the fields of the plan that force the expensive way
    instead: Scene | None = None  # an equivalent scene that takes the expensive way, if no field forces it


def decisions(opaque: Scene, glass: Scene, still: Scene) -> list[Decision]:
    """Return all decisions. `opaque` has many lights and light meshes; `glass` bends shadow paths; `still` has images
    and mirrors and no glass.
    """
    plain = glass.with_settings(caustics="PAPER")
    straight = dataclasses.replace(plain, materials=tuple(dataclasses.replace(m, ior=1.0) for m in plain.materials))
    coloured = dataclasses.replace(plain, materials=tuple(
        dataclasses.replace(m, kt=(m.kt[0], 0.9 * m.kt[1], 0.8 * m.kt[2])) for m in plain.materials))
    whitted, cast = opaque.with_settings(mode="WHITTED"), opaque.with_settings(mode="RAY_CASTING")
    half, things = len(opaque.lights) // 2, tuple(range(len(opaque.objects)))

    def lit(**values: Any) -> Scene:
        return dataclasses.replace(opaque, lights=tuple(dataclasses.replace(i, **values) for i in opaque.lights))

    def and_dark(scene: Scene, **values: Any) -> Scene:
        """Return the scene with one more light with soft shadows, which is too dark to be seen."""
        more = dataclasses.replace(opaque.lights[0], name="dark", intensity=(DARK,) * 3, **values)
        return dataclasses.replace(scene, lights=(*scene.lights, more))

    def first(**values: Any) -> Scene:
        return dataclasses.replace(opaque, objects=(
            dataclasses.replace(opaque.objects[0], **values), *opaque.objects[1:]))

    def dimmed(intensity: float) -> Scene:
        return dataclasses.replace(opaque, lights=tuple(
            dataclasses.replace(light, intensity=(intensity,) * 3) if n < half else light
            for n, light in enumerate(opaque.lights)))

    return [
        Decision("shadows", "none: no light casts any", lit(cast_shadow=False), opaque,
                 instead=and_dark(lit(cast_shadow=False))),
        Decision("shadows", "sharp: no light has soft ones", lit(soft_shadows=False), opaque,
                 instead=and_dark(lit(soft_shadows=False))),
        Decision("casters", "one set for all lights", opaque, and_dark(opaque, blockers=things[:1]),
                 instead=and_dark(opaque, blockers=things[:1])),
        Decision("receivers", "none are told apart", opaque, _with_twins(opaque, SHARP_TWIN),
                 instead=_with_twins(opaque, SHARP_TWIN)),
        Decision("light linking", "no light lights some objects only", opaque, lit(receivers=things),
                 instead=lit(receivers=things)),
        Decision("uniform skip", "on", opaque, glass.with_settings(caustics="FOCUS"), {"uniform_skip": False}),
        Decision("certificate", "on", opaque, None, {"certificate": False}),
        Decision("node values", "a bit a light: opaque surfaces only", opaque, straight, {"channels": 1}),
        Decision("node values", "a number a light: uncoloured glass", straight, coloured, {"channels": 3}),
        Decision("refracted shadow paths", "none: nothing bends", straight, plain, {"paths": True}),
        Decision("transparency", "none: all surfaces are opaque", cast, straight, {"transparent": True}),
        Decision("reflected rays", "none: nothing mirrors", whitted, still, {"reflections": True}),
        Decision("textures", "none: no coordinates of images on the hits", opaque, still, instead=_with_uvs(opaque)),
        Decision("accelerators", "one for all kinds of rays", opaque, _with_twins(opaque, SEEN_BY_ONE),
                 instead=_with_twins(opaque, SEEN_BY_ONE)),
        Decision("holdouts", "none", opaque, first(holdout=True), {"holdouts": True}),
        Decision("shadow catchers", "none", opaque, first(shadow_catcher=True), {"catchers": True}),
        Decision("dark lights", f"{half} of {len(opaque.lights)} never traced", dimmed(0.0), opaque,
                 instead=dimmed(DARK)),
    ]


def table(opaque: Scene, glass: Scene, still: Scene, repeats: int, say: Say) -> list[dict[str, Any]]:
    """Return the rows: the decision, why it was taken, why it is not taken in the other scene, whether the bits are the
    same, and the seconds of both ways.
    """
    rows = []
    for d in decisions(opaque, glass, still):
        runs: dict[str, list[Any]] = {"taken": [], "forced": []}
        for _ in range(repeats + 1):  # the first run warms the kernels up
            runs["taken"].append(render_image(d.taken))
            with forced(**d.forced):
                runs["forced"].append(render_image(d.instead or d.taken))
        reasons = runs["taken"][0].statistics["plan"]
        not_taken = render_image(d.other.with_settings(samples=1)).statistics["plan"] if d.other else {}
        same = np.array_equal(runs["taken"][0].passes["Combined"], runs["forced"][0].passes["Combined"])
        rows.append({
            "plan": d.plan, "what": d.what, "taken": reasons.get(d.plan, "nothing"),
            "other": not_taken.get(d.plan, "nothing"), "same_bits": same} | {
                f"{name}_seconds": _seconds(done, d.plan in PREPARED) for name, done in runs.items()})
        say(f"{d.plan}, {d.what}: {'the same bits' if same else 'OTHER BITS'}, {rows[-1]['taken_seconds']:.2f} s, "
            f"{rows[-1]['forced_seconds']:.2f} s when forced")
    return rows


def _seconds(done: list[Any], preparing: bool) -> float:
    """Return the seconds of a frame without the preparing, or with it if the decision is about the preparing."""
    return median(d.statistics["seconds"] - (0 if preparing else sum(
        d.statistics["stages"].get(stage, 0.0) for stage in PREPARING)) for d in done[1:])


def _with_uvs(scene: Scene) -> Scene:
    uvs = np.zeros((len(scene.geometry.triangles), 3, 2), np.float32)
    return dataclasses.replace(scene, geometry=dataclasses.replace(scene.geometry, uvs=uvs))


def _with_twins(scene: Scene, unlike: tuple[dict[str, bool], ...]) -> Scene:
    """Return the scene with some of its triangles doubled. The copies are separate objects that only rays of the kinds
    `unlike` see.

    It makes no difference which of two equal triangles a ray hits, but the scene can no longer be treated as one.
    """
    g = scene.geometry
    v0, nv, t0, _ = g.meshes[g.instance_mesh[0]].tolist()
    number = np.arange(len(unlike), dtype=np.int32)
    geometry = dataclasses.replace(
        g, meshes=np.concatenate([g.meshes, [(v0, nv, t0 + n, 1) for n in number.tolist()]]),
        instance_mesh=np.append(g.instance_mesh, len(g.meshes) + number),
        instance_object=np.append(g.instance_object, len(scene.objects) + number),
        instance_matrix=np.concatenate([g.instance_matrix, np.repeat(g.instance_matrix[:1], len(unlike), 0)]))
    hidden = {"visible_camera": False, "visible_reflection": False, "visible_shadow": False}
    twins = tuple(dataclasses.replace(scene.objects[g.instance_object[0]], name="twin", **(hidden | how))
                  for how in unlike)
    return dataclasses.replace(scene, geometry=geometry, objects=(*scene.objects, *twins))
