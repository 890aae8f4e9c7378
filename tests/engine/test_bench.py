"""The benchmark measures what it claims (references, errors, targets, rays), and a tiny run gives all of its output."""

import importlib.util
import json
import re
import runpy
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import light_meshes
import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, cylinder, rectangle
from light_meshes.bench import command, decisions, errors, judge, plots, rates, release, runs, scenes, targets, threads
from light_meshes.bench.embree import ShadowRays
from light_meshes.picture.plan import forced
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Light, Material
from light_meshes.scene.errors import SceneError
from profiles import QUANTISATION, half_ball
from scenes import edge, four_lights, hall, settings, with_lights

needs_blender = pytest.mark.skipif(not importlib.util.find_spec("bpy"), reason="bpy is not installed")


# --- References and errors ---------------------------------------------------------------------------------

@pytest.mark.parametrize("degrees", [45, 90, 120])
def test_the_half_ball_reference_is_the_closed_form(degrees):
    """The same r as kI = 2 asks for, and the error that its finer lattice leaves."""
    beta, r = np.radians(degrees), 0.2
    fine = errors.half_ball(edge(2.0, beta=beta))
    assert scenes.radius(fine) == pytest.approx(r) and fine.settings.kI == errors.FINE
    S = render_image(fine, ("Shadow",)).passes["Shadow"][..., 0]
    left, right = fine.camera.window[:2]
    expected = half_ball(left + (right - left) * (np.arange(S.shape[1]) + 0.5) / S.shape[1], r, beta)
    partly = (expected > 0) & (expected < 1)
    assert np.abs(S - expected)[:, partly].mean() <= QUANTISATION / errors.FINE**2


def test_the_penumbra_is_where_the_closed_form_has_it():
    scene = edge(2.0)
    found = errors.penumbra(scene)
    left, right = scene.camera.window[:2]
    x = left + (right - left) * (np.arange(found.shape[1]) + 0.5) / found.shape[1]
    S = half_ball(x, 0.2, np.pi / 2)
    sure = np.minimum(np.abs(S - 0.02), np.abs(S - 0.98)) > 3 * QUANTISATION / errors.FINE**2
    np.testing.assert_array_equal(found[:, sure], np.broadcast_to((S > 0.02) & (S < 0.98), found.shape)[:, sure])
    assert sure.mean() > 0.1


def test_errors_are_split_by_penumbra():
    found = np.zeros((2, 50, 3))
    found[0, 0], found[1, 1] = 0.3, 0.1
    partly = np.zeros((2, 50), bool)
    partly[0] = True
    e = errors.compare(found, np.zeros_like(found), partly)
    assert e["all"]["max"] == e["penumbra"]["max"] == pytest.approx(0.3)
    assert e["rest"]["max"] == pytest.approx(0.1)
    assert e["all"]["mae"] == pytest.approx(0.004)
    assert e["penumbra"]["rmse"] == pytest.approx(0.3 / np.sqrt(50))
    assert e["all"]["p99"] == pytest.approx(0.1, abs=0.01)


def test_a_light_is_given_the_size_that_the_radius_stands_for():
    """Its rays meet the occluder half way to every receiver: a/(L − a) = 1; a sun's meet it at a = 4."""
    scene = edge(2.0, light_radius=0.5)
    assert scenes.matched(scene)[0].radius == pytest.approx(0.2 / np.sqrt(1.25), rel=5e-3)
    scene = edge(2.0)
    assert np.tan(scenes.matched(scene)[0].angle / 2) == pytest.approx(0.2 / np.sqrt(1.25) / 4, rel=5e-3)


def test_with_the_matched_size_light_meshes_are_close_to_the_sphere():
    """Equal variance: the two profiles differ by .0095 at most (method §2), and less than with twice the size."""
    scene = edge(6.0, h=0.05, light_radius=0.5)
    scene = with_lights(scene, *scenes.matched(scene))
    soft = render_image(scene, ("Shadow",)).passes["Shadow"]

    def sampled(size):
        light = replace(scene.lights[0], radius=size * scene.lights[0].radius)
        return render_image(errors.sphere(with_lights(scene, light)), ("Shadow",)).passes["Shadow"]
    assert np.abs(soft - sampled(1.0)).mean() < 0.0095
    assert np.abs(soft - sampled(2.0)).mean() > 0.03


def test_the_same_power_whatever_the_number_of_lights():
    scene = hall(16, width=16)
    fewer = scenes.case("S8", scene, 4).scene
    assert len(fewer.lights) == 4
    np.testing.assert_allclose(fewer.lights[0].intensity, 4 * np.array(scene.lights[0].intensity))


# --- Rays, targets ------------------------------------------------------------------------------------------

def test_embree_alone_gets_the_very_rays_of_the_picture():
    scene = hall(4, width=48).with_settings(shadows="SHARP")
    rays = ShadowRays(scene, 16)
    assert rays.count == render_image(scene, tile_size=16).statistics["shadow_rays"] > 1000
    assert rays.trace(2) > 0


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="this Python does not tell who holds its lock")
def test_a_lock_that_is_held_is_told_from_one_that_is_not():
    def hold():
        end = time.monotonic() + 0.3
        while time.monotonic() < end:
            sum(range(100))

    scene = hall(4, width=48).with_settings(samples=4)
    assert threads.lock_held(hold) > 0.8
    assert threads.lock_held(lambda: time.sleep(0.3)) < 0.1
    assert 0 < threads.lock_share(scene) < 1


def test_preparing_is_measured():
    found = threads.preparing(hall(4, width=300))
    assert found["triangles"] > 100 and found["without_lamps"] == 0
    assert all(found[what]["seconds"] > 0 and found[what]["threads"] > 0 for what in ("accelerator", "certificate"))


def test_threads_have_their_targets():
    busy = {"accelerator": {"seconds": 1.0, "threads": 1.9}, "certificate": {"seconds": 1.0, "threads": 1.2}}
    found = {r["what"]: r for r in targets.targets(results(threads={
        "lock": {"S3, 1 light": 0.01, "S7, 16 lights": 0.03},
        "preparing": busy | {"triangles": 2_000_000, "without_lamps": 0.0}}))}
    reached = [r["reached"] for what, r in found.items() if "lock" in what or "triangles" in what]
    assert reached == [True, False, True, False, True]


@needs_blender
def test_releases_are_compared_frame_by_frame():
    """This one with itself, and with what is no release."""
    said = []
    found = release.table(sys.executable, 24, 1, said.append, [("S7", 4)])
    (one,) = found["rows"]
    assert found["versions"] == [light_meshes.__version__] * 2 and one["title"] == "S7, 4 lights" and len(said) == 1
    assert 0.05 < one["seconds"] < 20 and 0.05 < one["cpu"] < 20
    with pytest.raises(SceneError, match="ended"):
        release.table(str(shutil.which("true")), 24, 1, said.append)
    with pytest.raises(SceneError, match="cannot be started"):
        release.table("/no/python", 24, 1, said.append)


def test_releases_have_their_targets():
    rows = [{"title": "S3, 1 light", "seconds": 0.84, "cpu": 0.8},
            {"title": "S7, 16 lights", "seconds": 0.9, "cpu": 1.0}]
    found = [r for r in targets.targets(results(release={"versions": ["0.1.0", "0.2.0"], "rows": rows}))
             if "0.1.0" in r["what"]]
    assert [r["reached"] for r in found] == [True, False]
    (missing,) = [r for r in targets.targets(results()) if "release" in r["what"]]
    assert missing["measured"] is None and missing["reached"] is None


def results(**more):
    empty = {"embree": None, "process": None, "threads": None, "scenes": [], "times": [], "errors": []}
    return empty | more


def row(lights, method, seconds, kI=2.0, samples=4, light_samples=0, **more):
    soft = method == "light meshes"
    return {"scene": "S7", "lights": lights, "method": method, "kI": kI * soft, "h": 0.025 * soft, "samples": samples,
            "light_samples": light_samples, "frame": {"median": seconds}} | more


OWN = [{"scene": "S7", "lights": n, "h": 0.025, "kI": 2.0} for n in (1, 4, 16, 64, 256)]


def test_every_target_stands_in_the_table_measured_or_not():
    rows = targets.targets(results())
    assert len(rows) >= 14 and all(r["reached"] is None and r["measured"] is None for r in rows)


def test_targets_compare_medians_of_the_same_run():
    times = [row(n, "RRTA", 1.0 * n) for n in (1, 4, 16, 64, 256)]
    times += [row(n, "light meshes", s, nodes=100, node_bytes=2000)
              for n, s in ((1, 3.0), (4, 6.0), (16, 8.0), (64, 16.0), (256, 30.0))]
    times += [row(16, "light meshes", 0.1, kI=4.0)]  # not the scene's own kI
    found = {r["what"]: r for r in targets.targets(results(scenes=OWN, times=times))}
    ratio = {n: found[f"light meshes / RRTA, frame, S7, 4 samples a pixel, {n} lights"] for n in (4, 16, 64, 256)}
    assert [ratio[n]["measured"] for n in ratio] == pytest.approx([1.5, 0.5, 0.25, 30 / 256])
    assert [ratio[n]["reached"] for n in ratio] == [False, True, True, True]
    assert found["cost of 256 lights / of 1 light, light meshes, S7, 4 samples a pixel"]["measured"] == 10.0
    assert found["memory, bytes a node, 16 opaque lights"]["measured"] == 20.0
    even = found["break-even: light meshes are faster from so many lights on"]
    assert 4 < even["measured"] < 16
    assert even["measured"] == pytest.approx(4 * 4 ** (np.log(1.5) / np.log(3)))


@pytest.mark.parametrize(("ratios", "expected"), [({}, None), ({1: 0.9, 4: 0.5}, 1.0), ({1: 3.0, 4: 2.0}, None)])
def test_break_even_at_the_ends(ratios, expected):
    assert targets.break_even(ratios) == expected


def test_cycles_needs_a_hundred_times_the_samples_for_a_tenth_of_the_noise():
    def noise(method, rmse, reference, light_samples=0):
        return row(16, method, 0, samples=1, light_samples=light_samples, reference=reference, all={"rmse": rmse})
    times = [row(16, "Cycles", 0.5 * n, samples=1, light_samples=n) for n in (1, 4, 16)]
    times += [row(16, "light meshes", 2.0, samples=1)]
    wrong = [noise("Cycles", 0.2 / n**0.5, "CYCLES", n) for n in (1, 4, 16)]
    wrong += [noise("light meshes", 0.02, "SPHERE"), noise("light meshes", 0.5, "RRTA")]
    found = targets.cycles_ratios(results(scenes=OWN, times=times, errors=wrong), "S7")
    assert found == {16: pytest.approx(0.5 * 100 / 2.0)}
    target = next(r for r in targets.targets(results(scenes=OWN, times=times, errors=wrong)) if "Cycles" in r["what"]
                  and "S7" in r["what"])
    assert target["reached"] and "beyond what was measured: 16 lights" in target["remark"]  # 100 samples were not run


def test_a_shadow_rate_is_measured_against_every_sample(tmp_path):
    scene = hall(64, width=48, h=0.2)
    case = scenes.Case("S7", scene, tmp_path, 1.0, {}, "")
    rows = rates.table(case, 64, 1, True, lambda _: None, samples=1)
    assert [r["rate"] for r in rows] == [0, 1, 2, 4, 8] and "rmse" not in rows[0] and rows[1]["max"] == 0
    for r in rows[2:]:
        assert 0 < r["rmse"] < r["max"] and sum(r[name] for name in rates.SHARES) == pytest.approx(1)
    found = [r for r in targets.targets(results(rates=rows)) if r["what"].startswith("shadow rate 4")]
    assert found[0]["measured"] == rows[3]["frame"]["median"] / rows[0]["frame"]["median"]
    assert [r["measured"] for r in found[1:]] == [rows[3]["rmse"], rows[3]["max"]]


# --- Only what a scene needs --------------------------------------------------------------------------------

def glass(**values):
    bent = Material("glass", Od=(0.4, 0.4, 0.4), kd=0.3, kt=(0.7, 0.7, 0.7), ior=1.5)
    parts = [Shape(rectangle((-3, -3), (3, 3), 0.0), name="floor"),
             Shape(cylinder(0.6, 0.3, 1.0, 16), bent, "glass"), Shape(box((0.8, -0.2, 0), (1.2, 0.2, 0.9)), name="box")]
    return Scene.from_shapes(parts, Camera.look_at((3, -4, 3), (0, 0, 0.3), 40, 32, 32),
                             [Light("light", "POINT", (20.0,) * 3, position=(1.5, -1.0, 4.0))],
                             settings(h=0.1, kI=2.0, refraction="FULL", mode="WHITTED", **values))


def still():
    scene = four_lights(32, mode="WHITTED")
    shiny = tuple(replace(m, mirror=(0.3,) * 3) if m.name == "ball" else m for m in scene.materials)
    return replace(scene, materials=shiny)


def test_each_decision_of_the_plan_leaves_the_same_bits():
    said = []
    rows = decisions.table(hall(6, width=32), glass(), still(), 1, said.append)
    assert [r["what"] for r in rows if not r["same_bits"]] == []
    assert len(said) == len(rows) >= 11
    for r in rows:
        assert r["taken"] != r["other"] or r["plan"] == "textures", r  # still() has no image


def test_a_forced_plan_is_carried_out():
    """Else the table would compare a picture with itself."""
    scene = hall(6, width=24)
    taken = render_image(scene).statistics
    with forced(uniform_skip=False):
        traced = render_image(scene).statistics
    with forced(channels=1):
        numbers = render_image(scene).statistics
    assert taken["uniform_skips"] > 0 == traced["uniform_skips"]
    assert taken["short_rays"] < traced["short_rays"]
    assert taken["node_bytes"] < numbers["node_bytes"]
    assert render_image(scene).statistics["uniform_skips"] == taken["uniform_skips"]  # it ends with the block


def test_a_decision_that_changes_bits_is_told(monkeypatch):
    scene = hall(3, width=16)
    other = replace(scene, world_color=(0.5, 0.5, 0.5))
    monkeypatch.setattr(decisions, "decisions", lambda *_: [
        decisions.Decision("transparency", "wrong", scene, None, instead=other)])
    assert not decisions.table(scene, scene, scene, 1, lambda _: None)[0]["same_bits"]


# --- A run, end to end --------------------------------------------------------------------------------------

TINY = runs.Effort(size=48, repeats=2, kI=(2.0, 3.0), steps=(2.0,), shapes=(3.0,), samples=(1, 4), all_samples=(1, 4),
                   error_size=32,
                   cycles_reference=32, seconds=10)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """(results.json, table.txt, folder) of a run of S3 with everything but the hall."""
    folder, said = tmp_path_factory.mktemp("bench"), []
    done = runs.bench(TINY, ("S3", "cycles", "errors", "process"), said.append,
                      lambda r: command.write(r, folder, True))
    command.write(done, folder, True)
    assert len(said) > 20
    return json.loads((folder / "results.json").read_text()), (folder / "table.txt").read_text(), folder


@needs_blender
def test_a_run_has_times_and_errors_of_each_method(tiny):
    found, _, _ = tiny
    assert found["format"] == "light-meshes benchmark" and found["version"] == 1
    methods = {"RRTA", "light meshes", "lamp shape", "area sampling", "Cycles", "Cycles, denoised"}
    assert {r["method"] for r in found["times"]} == methods
    assert {r["method"] for r in found["errors"]} == methods | {"Cycles' reference"}
    for r in found["times"]:
        assert r["runs"] >= 1
        for what in ("whole", "frame", "shadow"):
            assert 0 <= r[what]["min"] <= r[what]["median"] <= r[what]["max"]
        assert 0 < r["frame"]["median"] <= r["whole"]["median"]
    for r in found["errors"]:
        assert r["reference"] in ("RRTA", "HALF_BALL", "SPHERE", "LAMPS", "CYCLES")
        assert 0 < r["all"]["rmse"] < 0.1
        assert r["all"]["mae"] <= r["all"]["rmse"] <= r["all"]["max"]
        assert not judge.available() or 0 < r["all"]["flip"] < 0.5
    assert found["process"]["first"] > 0
    assert 0 < found["errors"][0]["in_penumbra"] < 0.5


@needs_blender
def test_errors_are_what_the_method_leads_one_to_expect(tiny):
    """Cycles shows the same sphere light, finer lattices come nearer to the integral, more samples make less noise."""
    found, _, _ = tiny

    def rmse(label, reference):
        return next(r["all"]["rmse"] for r in found["errors"] if (r["label"], r["reference"]) == (label, reference))
    assert rmse("Cycles 32", "SPHERE") < 0.4 * rmse("RRTA", "SPHERE")
    assert rmse("light meshes kI 3, h 0.05", "HALF_BALL") < rmse("light meshes kI 2, h 0.075", "HALF_BALL")
    assert rmse("area sampling 4", "SPHERE") < rmse("area sampling 1", "SPHERE")
    assert rmse("Cycles 4", "CYCLES") < rmse("Cycles 1", "CYCLES")
    assert rmse("Cycles 4, denoised", "CYCLES") < rmse("Cycles 1, denoised", "CYCLES")
    assert rmse("Cycles 4, denoised", "CYCLES") != rmse("Cycles 4", "CYCLES")
    assert rmse("lamp shape kI 3", "LAMPS") < rmse("light meshes kI 3, h 0.05", "SPHERE")
    assert rmse("light meshes kI 3, h 0.05", "SPHERE") < rmse("RRTA", "SPHERE")


@needs_blender
def test_the_tables_and_figures_are_written(tiny):
    found, table, folder = tiny
    for r in found["targets"]:
        assert r["what"] in table
    assert "Cycles' time / light meshes' at the RMSE that these reach, S3" in table
    assert next(r for r in found["targets"] if r["what"].endswith("S3"))["measured"] > 0
    written = plots.draw(found, folder)
    assert {p.name for p in written} == {f"error-{r}.{kind}" for r in ("rrta", "half-ball", "sphere")
                                         for kind in ("svg", "png")}
    assert all(p.stat().st_size > 5000 for p in written)


@needs_blender
def test_what_was_measured_goes_into_the_documentation(tiny, tmp_path):
    found, table, folder = tiny
    plots.draw(found, folder)
    script = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "benchmark.py"))
    pages = [Path(shutil.copy(page, tmp_path)) for page in script["PAGES"]]
    script["insert"](folder, pages, tmp_path / "pictures")
    said = pages[0].read_text(encoding="utf-8")
    assert all(f"| {r['what']} |" in said for r in found["targets"]) and table.strip() in said
    pictures = re.findall(r"\]\((pictures/.*)\)", said)
    assert "pictures/bench-error-sphere.png" in pictures and all((tmp_path / p).is_file() for p in pictures)
    assert said.count(script["NOT_MEASURED"]) == 4  # lamps with a size, the hall's lamps, its growth, decisions
    assert "bench: main" in pages[1].read_text(encoding="utf-8")
    script["insert"](folder, pages, tmp_path / "pictures")
    assert pages[0].read_text(encoding="utf-8") == said


@needs_blender
def test_the_hall_at_any_number_of_triangles_is_the_hall(tmp_path):
    """S7 is described twice: in the .blend, and for growth."""
    file = scenes.exported("S7", tmp_path / "S7")
    made = scenes.hall(file, 338_724)

    def corners(scene):
        g = scene.geometry
        return sorted({tuple(np.round(m[:3, :3] @ v + m[:3, 3], 4)) for k, m in zip(
            g.instance_mesh, g.instance_matrix, strict=True) for v0, n, _, _ in [g.meshes[k]]
            for v in g.vertices[v0:v0 + n:97].astype(float)})
    assert len(file.lights) == 256
    sizes = [sum(scene.geometry.meshes[scene.geometry.instance_mesh, 3]) for scene in (file, made)]
    assert sizes == [338_724, 338_724]
    boxes = [np.array([np.min(corners(s), 0), np.max(corners(s), 0)]) for s in (file, made)]
    np.testing.assert_allclose(*boxes, atol=2e-2)
    small = [scenes.sized(scenes.case("S8", s, 2).scene, 64, samples=1, shadows="SHARP") for s in (file, made)]
    a, b = (errors.picture(s) for s in small)
    assert (np.abs(a - b) > 1e-3).any(-1).mean() < 0.01


# --- The command --------------------------------------------------------------------------------------------

@pytest.mark.parametrize(("only", "code", "word"), [("S3,S9", 2, "S9"), ("figures", 1, "does not exist")])
def test_bad_usage_has_a_sentence(tmp_path, only, code, word):
    done = subprocess.run([sys.executable, "-m", "light_meshes.cli", "bench", "--out", tmp_path, "--only", only],
                          capture_output=True, text=True)
    assert done.returncode == code
    assert word in done.stderr and "Traceback" not in done.stderr
