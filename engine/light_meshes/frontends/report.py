"""Describe a scene and the decisions of its plan as text."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..picture.render import Prepared
from ..scene.description import Material, Scene
from ..support.text import shown


def describe(scene: Scene) -> str:
    """Return the text of `light-meshes inspect`."""
    ready = Prepared(scene)
    scene = ready.scene
    s, g, camera = scene.settings, scene.geometry, scene.camera
    lines = ["Scene"]
    lines += _table([
        ("triangles", f"{len(ready.surfaces.triangles):,} of {len(g.meshes):,} meshes in {len(g.instance_mesh):,} "
                      f"instances of {len(scene.objects):,} objects"),
        ("camera", f"{'perspective' if camera.perspective else 'orthographic'}, {camera.width} × {camera.height} "
                   f"pixels" + (f", crop {camera.crop}" if camera.crop else "") +
                   (f", in focus at {camera.focus_distance:g}" if camera.lens_radius else "")),
        ("world colour", _colour(scene.world_color)),
    ])
    lines += [f"Lights ({len(scene.lights)})"]
    for light in scene.lights[:20]:
        shadows = ("soft" if light.soft_shadows else "sharp") if light.cast_shadow else "no"
        lines += _table([(light.name, f"{light.type.lower()}, I = {_colour(light.intensity)}, {shadows} shadows")])
    lines += [f"  … and {len(scene.lights) - 20} more"] if len(scene.lights) > 20 else []
    used = np.unique(g.triangle_materials).tolist()
    lines += [f"Materials ({len(used)} used)"]
    for i in used[:20]:
        m = scene.materials[i]
        lines += _table([(m.name, f"Od {_colour(m.Od)}" + (" (image)" if m.image >= 0 else "") +
                          f", kd {m.kd:.3g}, {_highlight(m)}, mirror {_colour(m.mirror)}")])
    lines += [f"  … and {len(used) - 20} more"] if len(used) > 20 else []
    lines += ["Settings"]
    lines += _table([
        ("mode, shadows", f"{s.mode}, {s.shadows}"),
        ("h, kI, r", f"{s.h:g}, {s.kI:g}, {s.h * s.kI:g}" + (" (h measured from what the camera sees)"
                                                             if s.auto_h else "")),
        ("samples", f"{s.samples} a pixel, filter of {s.filter_size:g} pixels"),
    ])
    lines += ["Plan"]
    lines += _table(list(ready.plan.reasons.items()))
    missing = [f"  {shown(w)}" for w in (*scene.warnings, *ready.warnings)]
    lines += [f"Not translated ({len(missing)})", *missing] if missing else ["All is translated."]
    return "\n".join(lines)


def summary(statistics: dict[str, Any]) -> str:
    """Return the statistics of a render as a few lines."""
    s = statistics
    rows = [(name, decision) for name, decision in s["plan"].items()]
    rows += [
        ("scene", f"{s['triangles']:,} triangles in {s['instances']:,} instances, {s['lights']:,} lights"),
        ("rays", f"{s['camera_rays']:,} camera, {s['secondary_rays']:,} secondary, {s['shadow_rays']:,} shadow"),
    ]
    if "nodes" in s:
        rows += [
            ("h, kI, r", f"{s['h']:g}, {s['kI']:g}, {s['r']:g}"),
            ("nodes", f"{s['nodes']:,} evaluated, {s['node_share']:.1%} of the lattice in the scene's box, "
                      f"{s['long_rays']:,} rays to lights"),
            ("receivers", f"{s['receivers']:,}, {s['uniform_skips']:,} skipped, {s['short_rays']:,} short rays, "
                          f"{s['spared_rays']:,} spared by the certificate, {s['empty_sets']:,} empty sets"),
        ]
    if "lamp_pairs" in s:
        share = [s[name] / s["lamp_pairs"] for name in ("mixed_pairs", "ray_pairs")]
        rows += [("lamps with a size", f"{s['lamp_pairs']:,} pairs of a receiver and a lamp, {share[0]:.1%} near "
                                       f"penumbrae, {share[1]:.1%} with rays of their own")]
    if "light_bound" in s:
        rows += [("light threshold", f"the light is wrong by at most {s['light_bound']:.2%} of what there is without "
                                     "shadows, on average over what is lit: what lamps give for which others stand")]
    if "shadow_rate" in s:
        samples = s["interpolated"] + s["refined"] + s["computed"]
        share = [s[name] / max(samples, 1) for name in ("interpolated", "refined", "computed")]
        rows += [("shadow rate", f"{s['shadow_rate']}, {s['points']:,} points; of {samples:,} samples {share[0]:.1%} "
                                 f"interpolated, {share[1]:.1%} in smaller blocks, {share[2]:.1%} computed")]
    if "refracted_paths" in s:
        lost = s["path_seeds_not_converged"] / max(s["path_seeds"], 1)
        rows += [("refracted paths", f"{s['refracted_paths']:,} from {s['path_seeds']:,} seeds, of which {lost:.1%} "
                                     f"did not converge; {s['path_rays']:,} rays")]
    stages = ", ".join(f"{name} {seconds:.2f}" for name, seconds in s["stages"].items())
    rows += [("seconds", f"{s['seconds']:.2f} on {s['threads']} threads; of their time: {stages}")]
    if s["peak_memory"]:
        rows += [("peak memory", f"{s['peak_memory'] / 2**20:,.0f} MiB")]
    return "\n".join(_table(rows))


def _table(rows: list[tuple[str, str]]) -> list[str]:
    return [f"  {shown(name):<22} {shown(value)}" for name, value in rows]


def _highlight(m: Material) -> str:
    if m.highlight == "PHONG":
        return f"ks {m.ks:.3g}, nShiny {m.nShiny:.3g}"
    return (f"roughness {m.roughness:.3g}, metal {m.metal:.3g} of {_colour(m.F0)}, dielectric {m.dielectric:.3g} of "
            f"ior {m.dielectric_ior:.3g}")


def _colour(rgb: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{c:.3g}" for c in rgb) + ")"
