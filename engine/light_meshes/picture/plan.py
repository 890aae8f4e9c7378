"""The plan: what this scene needs (method §5). It is decided before tracing, and the statistics give each decision with
its reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from ..film.passes import DEBUG
from ..glass.interfaces import Interfaces
from ..scene.description import Light, Material, Scene
from ..shadows import ray_counts
from ..shadows.blocks import edge
from ..shadows.casters import Casters, smooth_lights, union
from ..shadows.method import Kind
from ..shadows.radius import extent
from ..shadows.registry import KINDS, NONE
from ..shadows.sized import LEVELS
from ..support.bits import has
from ..surface import clusters

SHARED = (1.0, 2.5)  # sizes of the pixel filter with which pixels share samples
MANY_LAMPS = 128  # from so many on the plan proposes the light threshold
LAMP_RAYS = 16  # that a lamp with a size takes where no certificate says that nodes may answer


@dataclass
class Plan:
    """The simplest computation that gives the picture."""

    shadows: str = NONE  # the name of a shadow method in the registry
    reflections: bool = False
    blurred: bool = False  # surfaces have lobes of microfacets, which show what is around
    follows: bool = True  # rays are sent along them; otherwise they show the world only
    translucent: bool = False  # light comes through some surfaces scattered
    layers: bool = False  # some surfaces reflect by more than one layer
    frosted: bool = False  # some glass is rough
    spreads: bool = False  # of which some are bright, and spread rays out
    transparent: bool = False  # rays pass through surfaces
    paths: bool = False  # shadow paths bend (eq. 6)
    uniform_skip: bool = False
    shadow_rate: int = 1  # distance in pixels of the points whose light is computed; between them it is interpolated
    certificate: bool = False  # no short rays are traced where nothing else is near
    threshold: bool = False  # one lamp of a group stands for the shadows of all
    shares: bool = False  # nodes hold shares of lamps with a size
    blocks: bool = False  # of many such lamps the blocks of the picture find out where they are seen in part
    certifies_lamps: bool = False  # the same for lamps with a size, which it spares more rays
    channels: int = 0  # of a node's value for a light: 0 a bit, 1 a number, 3 RGB
    textures: bool = False
    holdouts: bool = False  # the camera sees some objects as holes
    catchers: bool = False  # the camera sees some surfaces only by the shadows on them
    patches: bool = False  # rays of rough surfaces see the patches of gathered light
    shares_samples: bool = False  # pixels take the samples of those around, too
    gathers: bool = False  # light comes from everywhere: from the sky with occlusion, or from surface to surface
    reasons: dict[str, str] = field(default_factory=dict)

    @property
    def kind(self) -> Kind:
        """Return the kind of the shadow method, which says what it can do."""
        return KINDS[self.shadows]

    def decide(self, what: str, value: object, why: str) -> None:
        """Record a decision and its reason, for the statistics."""
        self.reasons[what] = f"{value}: {why}"


def plan(scene: Scene, glass: Interfaces, casters: Casters, passes: tuple[str, ...] = ("Combined",),
         step: str = "", pinpoints: Mapping[int, float] = MappingProxyType({})) -> Plan:
    """Decide what `scene` needs for `passes`; `glass` says what is transparent in it and `casters` what casts shadows.

    `step` says why the automatic step is not the one that the camera alone gives; pinpoints: `Measured.pinpoints`.
    """
    s, p = scene.settings, Plan()
    used = scene.geometry.triangle_materials
    count = np.bincount(used, minlength=len(scene.materials)) if len(used) else np.zeros(len(scene.materials))
    materials = [m for m, n in zip(scene.materials, count, strict=True) if n]
    lights = [light for light in scene.lights if any(light.intensity)]
    _shadows(p, scene, casters, lights)
    if p.kind.soft:
        _soft_lights(p, scene, casters, len(lights), step)
    if any(light.receivers is not None for light in lights):
        p.decide("light linking", "yes", f"{sum(light.receivers is not None for light in lights)} lights light some "
                 "objects only")
    _transparency(p, scene, glass)
    if p.kind.lattice:
        words = (len(scene.lights) + 63) // 64
        values = {0: (f"{words} × 64 bits", "opaque surfaces only"), 1: ("a number a light", "uncoloured glass"),
                  3: ("RGB a light", "coloured glass")}[p.channels]
        p.decide("node values", values[0], f"{values[1]}, {len(scene.lights)} lights")
    if KINDS[s.shadows].lattice and p.shadows != NONE:
        _lamps_with_a_size(p, scene, casters, pinpoints)
    _light_threshold(p, scene)
    if s.shadow_rate > 1:
        _shadow_rate(p, scene, casters, passes)
    if p.kind.lattice:
        _short_rays(p, scene)
    p.layers = any(m.layers for m in materials)
    materials += [layer for m in materials for layer in m.layers]
    _reflections(p, scene, glass, materials)
    p.textures = any(m.image >= 0 for m in materials)
    p.decide("textures", "yes" if p.textures else "no",
             f"{sum(m.image >= 0 for m in materials)} materials have an image")
    _everywhere(p, scene, materials, lights)
    hidden = sum(not (o.visible_camera and o.visible_reflection and o.visible_shadow) for o in scene.objects)
    p.decide("accelerators", "one" if not hidden else "one a kind of ray",
             f"{hidden} objects are hidden from some rays")
    if len(lights) < len(scene.lights):
        p.decide("dark lights", len(scene.lights) - len(lights), "no energy: never traced")
    _holes(p, scene)
    _samples(p, scene)
    if any(name.startswith("Shadow") for name in passes) and p.shadows == NONE:
        p.decide("shadow passes", "lit sides", "nothing casts a shadow")
    if any(name in passes for name in DEBUG) and not p.kind.counts:
        p.decide("debug passes", "empty", "without light meshes nothing is counted")
    return replace(p, **(_forced.get() or {}))


def _shadows(p: Plan, scene: Scene, casters: Casters, lights: list[Light]) -> None:
    """Decide which kind of shadows is needed: none, sharp, or as set."""
    s = scene.settings
    if s.mode == "LOCAL":
        p.decide("shadows", "none", "local illumination has none")
    elif not any(light.cast_shadow for light in lights):
        p.decide("shadows", "none", "no light casts any")
    elif KINDS[s.shadows].soft and not casters.soft:
        p.shadows = "SHARP"
        sharp = not any(light.soft_shadows and light.cast_shadow for light in lights)
        nowhere = casters.receives is not None and not casters.receives.any()
        p.decide("shadows", "sharp", "no light has soft shadows" if sharp else "no surface receives soft shadows"
                 if nowhere else "no light with a size has a caster of soft shadows")
    else:
        p.shadows = s.shadows
        p.decide("shadows", s.shadows.lower().replace("_", " "), "as set")


def _soft_lights(p: Plan, scene: Scene, casters: Casters, lights: int, step: str) -> None:
    """Decide which lights and surfaces have soft shadows, and record the step between nodes.

    `lights` is the number of lights that shine.
    """
    soft = sum(int(word).bit_count() for word in union(casters.soft, len(scene.lights)))
    if step and p.kind.lattice:
        p.decide("step", f"{scene.settings.h:.3g}", step)
    if soft < lights:
        p.decide("soft lights", soft, f"the other {lights - soft} need no column in the nodes")
    if len(casters.sets) > 1:
        p.decide("casters", f"{len(casters.sets)} sets", "soft and sharp casters, or lights' blockers, come apart")
    else:
        p.decide("casters", "one set", "all that cast shadows do so alike, in every light")
    if casters.receives is not None:
        p.decide("receivers", f"{int(casters.receives.sum()):,} triangles",
                 f"shadows on the other {int((~casters.receives).sum()):,} are sharp")


def _transparency(p: Plan, scene: Scene, glass: Interfaces) -> None:
    """Decide whether surfaces let light through, with how many channels, and whether light paths bend."""
    s = scene.settings
    p.transparent = glass.transparent
    if glass.lets_through.any() and p.shadows != NONE:
        p.channels = 3 if glass.coloured else 1
    if p.transparent:
        bent = int(glass.bending.sum())
        p.decide("transparency", "yes", f"{'with' if bent else 'without'} refraction, {bent} triangles bend rays")
        straight = p.shadows != NONE and not p.kind.bends
        p.paths = s.refraction == "FULL" and p.channels > 0 and glass.bends_shadows and not straight
        p.decide("refracted shadow paths", "yes" if p.paths else "no",
                 f"refraction is {s.refraction.lower()}" if p.paths or s.refraction != "FULL" else
                 "no closed mesh of glass bends" if not glass.bends_shadows else
                 f"{p.shadows.lower().replace('_', ' ')} has straight rays" if straight else "nothing casts a shadow")
        if p.channels and s.refraction == "VIEW" and glass.bends_shadows:
            dark = s.glass_shadows == "SOLID"
            p.decide("shadows of glass", s.glass_shadows.lower(), "light that glass turns aside is missing" if dark
                     else "light goes straight through")
    else:
        p.decide("transparency", "no", "all surfaces are opaque")


def _shadow_rate(p: Plan, scene: Scene, casters: Casters, passes: tuple[str, ...]) -> None:
    """Decide whether light may be interpolated between pixels."""
    s = scene.settings
    why_not = ("only light meshes' shadows are smooth" if not p.kind.lattice else
               "each light's shadows are sharp in part" if not smooth_lights(casters, len(scene.lights)).any() else
               "where light comes through surfaces, rays to lamps with a size say it at each sample"
               if p.channels and any(_sized(scene, casters)) else
               "light that glass has bent may change from pixel to pixel" if p.paths else
               "shadow passes show every sample" if any(n.startswith("Shadow") for n in passes) else "")
    p.shadow_rate = 1 if why_not else s.shadow_rate
    p.decide("shadow rate", p.shadow_rate, why_not or
             "what the camera sees is interpolated between points up to so many pixels apart")


def _light_threshold(p: Plan, scene: Scene) -> None:
    """Decide whether lamps have shadows in groups."""
    s = scene.settings
    p.threshold = p.shadows != NONE and KINDS[s.shadows].lattice and s.light_threshold > 0 and len(scene.lights) > 1
    if p.threshold:
        p.decide("light threshold", f"{s.light_threshold:g}",
                 "lamps that together give at most this share of the light somewhere have one shadow there, and with "
                 f"{clusters.MANY} lamps or more light as one where they are far away: a group's error is below it, "
                 "and that of all below what the statistics say")
    elif p.shadows != NONE and KINDS[s.shadows].lattice and len(scene.lights) > MANY_LAMPS:
        p.decide("light threshold", "0",
                 f"each of {len(scene.lights)} lamps has shadows of its own; .01 is several times faster")


def _sized(scene: Scene, casters: Casters) -> list[str]:
    """Return the names of the lights that have the soft shadow of their own shape."""
    soft = union(casters.soft, len(scene.lights))
    return [light.name for i, light in enumerate(scene.lights) if light.softness == "SIZE" and has(soft, i)]


def _lamps_with_a_size(p: Plan, scene: Scene, casters: Casters, pinpoints: Mapping[int, float]) -> None:
    """Decide how lamps that have the shadow of their own shape get it, and which of them have sharp shadows."""
    def names(of: list[str]) -> str:
        return ", ".join(f"'{name}'" for name in of[:3]) + (f" and {len(of) - 3} more" if len(of) > 3 else "")

    lamps, h = _sized(scene, casters), scene.settings.h
    points = [light.name for light in scene.lights if light.softness == "SIZE" and light.soft_shadows
              and any(light.intensity) and not extent(light)]
    if points:
        p.decide("lamps without a size", "sharp", f"{names(points)}: one ray says all of a point")
    small = [scene.lights[i].name for i in pinpoints if has(union(casters.whole, len(scene.lights)), i)]
    if small:
        p.decide("lamps smaller than a pixel", "sharp",
                 f"{names(small)}: one ray says all, the edges in view are {max(pinpoints.values()):.2g} pixels wide")
    if lamps:
        kI = scene.settings.kI
        rays, many = ray_counts.most(kI, len(lamps)), ray_counts.many(len(lamps))
        p.shares = True
        p.blocks = many and not p.paths and scene.settings.shadow_rate <= 1
        how, why = "shares at nodes", (
            f"{LEVELS} lattices, of h = {h:.3g} to {h * 2**(LEVELS - 1):.3g}, by the penumbra's width; "
            + (f"{int(ray_counts.shared(kI).counts[0])} to {rays.most} rays, by what the lamp gives, where it is "
               "narrower than r" if many else
               f"{rays.first} rays where it is narrower than r, up to {rays.most} where something is near")
            + (", or where light comes through surfaces" if p.channels else ""))
        if p.blocks:
            few, last = (int(ray_counts.in_blocks(kI).counts[k]) for k in (0, -1))
            wide = 2 * edge(scene.settings.samples)
            fits = ray_counts.rules(kI, scene.settings.samples).windows
            how, why = "blocks of the picture, and rays", (
                f"{wide}² pixels find out together what they see of each lamp; where they do not agree, "
                + ("means of a ray a sample where its penumbra is wide, else " if fits else "")
                + f"{few} to {last} rays, by what the lamp gives; in mirrors and behind glass {how}")
        if p.paths:
            why += "; light that glass bends comes from the lamp's centre"
        p.decide("lamps with a size", how, f"{names(lamps)}: {why}")


def _short_rays(p: Plan, scene: Scene) -> None:
    """Decide where light meshes need no short rays: by the uniform skip and the certificate."""
    s = scene.settings
    apart = p.paths and (s.leak_free or s.caustics == "FOCUS")
    through = p.channels > 0 and s.glass == "PAPER"
    p.uniform_skip = s.uniform_skip and not apart and not through
    p.decide("uniform skip", "on" if p.uniform_skip else "off",
             "each path counts by where it comes from" if apart else
             "nodes behind glass count in part" if through else "exact, saves short rays")
    rays, triangles = s.samples * scene.camera.width * scene.camera.height, len(scene.geometry.triangle_materials)
    p.certificate = rays >= 2 * triangles
    p.certifies_lamps = LAMP_RAYS * rays >= 2 * triangles
    p.decide("certificate", "on" if p.certificate else "off",
             "no short rays where only a convex object, or one plane, is near" if p.certificate else
             "more triangles to look at than it would save short rays")


def _reflections(p: Plan, scene: Scene, glass: Interfaces, materials: list[Material]) -> None:
    """Decide whether rays are reflected, by `materials` (those in use) or inside glass."""
    s = scene.settings
    lobes = [m.name for m in materials if m.blurred and m.highlight == "GGX" and not m.fresnel]
    mirrors = [m.name for m in materials if any(m.mirror) or (m.fresnel and any(m.kt)) or m.name in lobes]
    totally = bool(glass.bending.any())  # total internal reflection
    p.reflections = s.mode == "WHITTED" and (bool(mirrors) or totally) and s.max_depth > 0
    if s.mode != "WHITTED":
        p.decide("reflected rays", "no", f"mode {s.mode.lower().replace('_', ' ')}")
    elif mirrors:
        p.decide("reflected rays", f"up to {s.max_depth}", f"{len(mirrors)} materials mirror, '{mirrors[0]}' first")
    elif totally:
        p.decide("reflected rays", f"up to {s.max_depth}", "total reflection inside glass")
    else:
        p.decide("reflected rays", "no", "no material mirrors")
    p.frosted = s.refraction != "NONE" and any(
        any(m.kt) and (m.frosted > 0 or "frosted" in m.program.values) for m in materials)
    p.translucent = any(any(m.translucent) or "translucent" in m.program.values for m in materials)
    p.blurred = bool(lobes)
    p.spreads = p.frosted or (p.blurred and p.reflections and any(
        m.name in lobes and max(m.metal, m.coat) > 0.1 for m in materials))
    if p.frosted:
        p.decide("rough glass", "yes", "what is seen through it is blurred")
    if lobes:
        p.decide("rough reflections", "rays" if p.reflections else "the world only",
                 f"{len(lobes)} materials with lobes of microfacets, '{lobes[0]}' first")


def _holes(p: Plan, scene: Scene) -> None:
    """Record the objects that the camera sees as holes, or only by the shadows on them."""
    holdouts, catchers = (sum(getattr(o, flag) and o.visible_camera for o in scene.objects)
                          for flag in ("holdout", "shadow_catcher"))
    p.holdouts, p.catchers = holdouts > 0, catchers > 0
    if holdouts:
        p.decide("holdouts", holdouts, "camera rays end there")
    if catchers:
        p.decide("shadow catchers", catchers, "camera rays pass them, dimmed by the shadows there")


def _samples(p: Plan, scene: Scene) -> None:
    """Decide whether pixels share their samples."""
    s = scene.settings
    if not s.share_samples:
        return
    why_not = ("one sample is in the pixel's centre" if s.samples == 1 else
               "the filter hardly reaches other pixels" if s.filter_size < SHARED[0] else
               "the filter reaches over many pixels" if s.filter_size > SHARED[1] else "")
    p.shares_samples = not why_not
    p.decide("samples", "of each pixel alone" if why_not else "shared", why_not or
             f"a pixel takes those up to {s.filter_size:g} pixels away, weighted by the filter")


def _everywhere(p: Plan, scene: Scene, materials: list[Material], lights: list[Light]) -> None:
    """Decide whether the world's light is the same everywhere, and whether light is gathered from everywhere."""
    s, by_sky = scene.settings, scene.settings.by_sky
    ambient = any(scene.world_color) and s.ambient > 0 and not by_sky
    p.decide("ambient light", "yes" if ambient else "no",
             "the world's light is gathered" if by_sky else "world colour × ambient × ka")
    if not s.gathers:
        return
    matt = any(m.kd > 0 or "kd" in m.program.values or "Od" in m.program.values for m in materials)
    sources = [name for name, there in (("the world", by_sky and any(scene.world_color)),
                                        ("emitting surfaces", any(m.emits for m in materials)),
                                        ("lit surfaces", bool(lights) and s.bounces > 0)) if there]
    p.gathers = bool(sources) and matt
    p.decide("light from everywhere", f"{s.bounces} bounces" if p.gathers else "no",
             "no surface is matt" if not matt else ", ".join(sources) or "nothing sends any")
    p.patches = s.fast_reflections and p.gathers and (p.frosted or (p.blurred and p.reflections)) and not ambient
    if p.patches:
        p.decide("rough reflections", "patches", "they show matt surfaces by the light that these send others")


def darkness(scene: Scene, p: Plan) -> list[str]:
    """Return a sentence if there is something to be lit but no light lights it."""
    if p.gathers:
        return []
    used = [scene.materials[i] for i in np.unique(scene.geometry.triangle_materials)]
    used += [layer for m in used for layer in m.layers]
    if any(any(light.intensity) for light in scene.lights) or not any(
            m.kd > 0 or m.ks > 0 or m.metal > 0 or m.dielectric > 0 or m.sheen > 0 for m in used):
        return []
    names = [f"'{light.name}'" for light in scene.lights[:3]] + ["others"] * (len(scene.lights) > 3)
    why = (f"the light of {', '.join(names)} is 0: give it power and a colour" if names else
           "there is none in the render: add one (Shift A, Light), or show those that are hidden")
    emitters = "; surfaces with emission light nothing else, so put a lamp there" if any(
        any(m.emission) for m in used) else ""
    return [f"No lamp lights the scene, {why}{emitters}"]


_forced: ContextVar[dict[str, Any] | None] = ContextVar("forced", default=None)


@contextmanager
def forced(**fields: Any) -> Iterator[None]:
    """Within this context, plans that this thread makes have these fields. It is used to measure and test what a
    decision saves.
    """
    token = _forced.set(fields)
    try:
        yield
    finally:
        _forced.reset(token)
