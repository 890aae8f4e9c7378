"""The contest's judge says what it should of pictures with a known answer; a tiny contest gives all of its output."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes import cli
from light_meshes.bench import cells, contest, contest_tables, crops, judge
from light_meshes.bench.cells import Cell, Way

needs_blender = pytest.mark.skipif(not importlib.util.find_spec("bpy"), reason="bpy is not installed")
needs_flip = pytest.mark.skipif(not judge.available(), reason="flip-evaluator is not installed")


# --- FLIP ------------------------------------------------------------------------------------------------------

def lab(rgb):
    """CIELAB of linear RGB with FLIP's Hunt effect: colours count less where it is dark."""
    to_xyz = np.array([[10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
                       [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
                       [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382]])
    ratio = to_xyz @ rgb / to_xyz.sum(1)
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    lightness = 116 * f[1] - 16
    return np.array([lightness, 0.01 * lightness * 500 * (f[0] - f[1]), 0.01 * lightness * 200 * (f[1] - f[2])])


def flip_of_colours(reference, found):
    """LDR-FLIP of two even pictures: only the colour's pipeline counts (Andersson et al. 2020, equations 8 to 11)."""
    def apart(a, b):
        a, b = lab(np.asarray(a, float)), lab(np.asarray(b, float))
        return (abs(a[0] - b[0]) + np.hypot(*(a[1:] - b[1:]))) ** 0.7
    most = apart((0, 1, 0), (0, 0, 1))
    d = apart(reference, found)
    return 0.95 * d / (0.4 * most) if d < 0.4 * most else 0.95 + 0.05 * (d - 0.4 * most) / (0.6 * most)


def aces(x):
    x = 0.6 * np.asarray(x, float)
    return np.clip((2.51 * x * x + 0.03 * x) / (2.43 * x * x + 0.59 * x + 0.14), 0, 1)


@needs_flip
@pytest.mark.parametrize("found", [(0.5, 0.5, 0.5), (0.3, 0.25, 0.2), (0.2, 0.25, 0.4)])
def test_flip_of_even_pictures_is_the_published_formula(found):
    """The largest over the exposures, which the evaluator tells. (It shrinks even errors at the rim of the picture.)"""
    import flip_evaluator
    reference = np.full((64, 64, 3), 0.25, np.float32)
    test = np.full_like(reference, found)
    _, _, used = flip_evaluator.evaluate(reference, test, "HDR", applyMagma=False)
    steps = np.linspace(used["startExposure"], used["stopExposure"], int(used["numExposures"]))
    expected = max(flip_of_colours(aces(reference[0, 0] * 2.0**e), aces(test[0, 0] * 2.0**e)) for e in steps)
    assert judge.flip(reference, test)[32, 32] == pytest.approx(expected, abs=2e-3)


@needs_flip
def test_flip_is_0_for_the_same_picture_and_between_0_and_1():
    random = np.random.default_rng(1)
    picture = random.random((32, 48, 3)).astype(np.float32) ** 4 * 10
    assert judge.flip(picture, picture).max() == 0
    other = judge.flip(picture, random.random((32, 48, 3)).astype(np.float32))
    assert other.shape == (32, 48) and 0.1 < other.mean() <= other.max() <= 1


@needs_flip
def test_flip_of_a_night_and_of_broken_pixels_is_a_number():
    night = np.zeros((32, 32, 3), np.float32)
    night[:4, :4] = 0.5
    found = night.copy()
    found[2, 2], found[20, 20] = np.nan, np.inf
    for reference in (night, np.zeros_like(night)):
        error = judge.flip(reference, found)
        assert np.isfinite(error).all() and error[20, 20] > 0.3
    assert judge.flip(night, night).max() == 0


# --- Edges, errors ---------------------------------------------------------------------------------------------

WIDTH, HEIGHT = 64, 48


def seen(shift=0.0, step=False):
    """Guides of a wall at the depth 4 before a camera that moves by `shift` pixels; with `step`, its right half is
    nearer.
    """
    focal, depth = 50.0, 4.0
    to_pixel = np.array([[focal, 0, -WIDTH / 2, -shift * depth], [0, -focal, -HEIGHT / 2, 0], [0, 0, 1, 0],
                         [0, 0, -1, 0]])
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    z = np.where(step & (x > WIDTH / 2), depth - 1, depth)
    place = np.stack([((x - WIDTH / 2) * z + shift * depth) / focal, -(y - HEIGHT / 2) * z / focal, -z], -1)
    normal = np.broadcast_to(np.array([0, 0, 1], np.float32), place.shape)
    return judge.Guides(place.astype(np.float32), normal, np.ones((HEIGHT, WIDTH), np.int64), to_pixel)


def test_an_edge_is_where_the_plane_ends():
    assert not judge.edges(seen()).any()
    found = judge.edges(seen(step=True))
    assert found[:, WIDTH // 2 - 1:WIDTH // 2 + 1].all()
    assert not found[:, :WIDTH // 2 - 1].any() and not found[:, WIDTH // 2 + 1:].any()


def test_an_edge_is_where_another_thing_begins_or_the_surface_turns():
    at = seen()
    thing = at.thing.copy()
    thing[10:20, 10:20] = 2
    found = judge.edges(judge.Guides(at.place, at.normal, thing, at.to_pixel))
    assert found[10, 10:20].all() and found[9, 9] and not found[11:19, 11:19].any() and not found[22:].any()
    for degrees, expected in ((15, False), (25, True)):
        normal = at.normal.copy()
        normal[24:] = 0, np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
        assert judge.edges(judge.Guides(at.place, normal, at.thing, at.to_pixel))[23:25].all() == expected


def test_errors_at_edges_count_only_in_the_whole():
    reference = np.full((32, 32, 3), 0.25, np.float32)
    found, edge = reference.copy(), np.zeros((32, 32), bool)
    found[:, 16], edge[:, 16] = 0.75, True
    errors, shown = judge.compare(reference, found, edge, exposure=1.0)
    assert errors["rmse"] == 0 and errors["edges"] == 1 / 32
    assert errors["rmse_whole"] == pytest.approx(2 * 0.5 / np.sqrt(32))
    assert shown[16, 16] > 0.1
    if judge.available():
        assert errors["flip"] == 0 < errors["flip_whole"]


# --- Flicker ---------------------------------------------------------------------------------------------------

def test_a_surface_that_only_moves_in_the_picture_does_not_flicker():
    guides = [seen(shift) for shift in (0.0, 0.4, 0.8, 1.2)]
    frames = [(0.3 + 0.1 * np.sin(2 * at.place[..., :1]) + np.zeros(3)).astype(np.float32) for at in guides]
    found = judge.flicker(frames, guides)
    assert found["flicker"] < 5e-4 and found["compared"] > 0.9
    as_pixels = judge.flicker(frames, [guides[0]] * 4)  # as if the camera stood still
    assert as_pixels["flicker"] < found["flicker"] * 20  # an even drift hardly counts


def test_flicker_is_the_noise_of_a_frame():
    random = np.random.default_rng(3)
    guides = [seen(shift) for shift in (0.0, 1.0, 2.0, 3.0)]
    noise = random.normal(0, 0.02, (4, HEIGHT, WIDTH, 3))
    level = judge.screen(np.float32(0.2))
    frames = [(((level + n + 0.055) / 1.055) ** 2.4).astype(np.float32) for n in noise]  # linear light
    assert judge.flicker(frames, guides)["flicker"] == pytest.approx(0.02, rel=0.05)


def test_what_is_hidden_in_another_frame_is_not_compared():
    guides = [seen(), seen(), seen(step=True)]
    frames = [np.full((HEIGHT, WIDTH, 3), v, np.float32) for v in (0.2, 0.2, 0.8)]
    found = judge.flicker(frames, guides)
    assert 0.3 < found["compared"] < 0.55  # the left half only


# --- Tables and crops ------------------------------------------------------------------------------------------

def row(engine, seconds, flip, samples=1, denoise=False, level=""):
    way = Way(engine, level, samples, denoise)
    return way.name, {"label": way.label, "engine": engine, "level": level, "samples": samples, "denoise": denoise,
                      "seconds": seconds, "processor": 2 * seconds, "memory": 2**28, "warnings": [], "edges": 0.1,
                      "rmse": 2 * flip, "rmse_whole": 3 * flip, "flip": flip, "flip_whole": 1.5 * flip}


ROWS = dict([row("LIGHT_MESHES", 2.0, 0.05, level="BALANCED"), row("CYCLES", 1.0, 0.2, 1, True),
             row("CYCLES", 2.1, 0.08, 4, True), row("CYCLES", 9.0, 0.04, 16, True), row("CYCLES", 8.0, 0.05, 16),
             row("CYCLES", 30.0, 0.03, 64, True)])


def test_rivals_at_equal_error_and_at_equal_time():
    assert contest_tables.equal_error(ROWS) == "cycles_16_denoised" and contest_tables.faster(ROWS) == (4.5, False)
    assert contest_tables.equal_time(ROWS) == "cycles_4_denoised"


def test_a_rival_that_is_never_as_near_gives_a_bound():
    rows = ROWS | dict([row("LIGHT_MESHES", 2.0, 0.01, level="BALANCED")])
    assert contest_tables.equal_error(rows) == "cycles_64_denoised" and contest_tables.faster(rows) == (15.0, True)
    assert contest_tables.faster({}) is None and contest_tables.equal_time({"balanced": ROWS["balanced"]}) is None


def test_the_references_own_noise_follows_from_that_of_fewer_samples():
    """RMSE of 16 samples against 64: √(1/16 + 1/64)·σ."""
    rows = dict([row("CYCLES", 8.0, 0.5 * np.sqrt(1 / 16 + 1 / 64), 16), row("CYCLES", 1.0, 7.0, 1)])
    assert contest_tables.reference_noise(rows, 64) == pytest.approx(1 / np.sqrt(64))
    assert contest_tables.reference_noise({}, 64) is None


def test_the_page_says_which_targets_are_reached():
    flight = {"balanced": {"flicker": 0.005}, "cycles_4_denoised": {"flicker": 0.05}, "floor": {"flicker": 0.004}}
    flight = {name: {"label": name, "seconds": 1.0, "first": 2.0, "compared": 0.5} | f for name, f in flight.items()}
    scene = {"reference": 8, "rows": ROWS, "flight": flight,
             "failed": [{"label": "Cycles 1", "frames": [1], "why": "exit code 1\nno"}]}
    said = contest_tables.text({"size": (64, 36), "frame": 10, "machine": {"cores": 2},
                                "scenes": {"room": scene, "stage": scene,
                                           "street": {"reference": 16, "rows": {}, "flight": {}, "failed": []}}})
    assert "| room | 2.00 | 0.0500 | Cycles 16, denoised: 9.00 s | 4.50 | ≥ 3: reached |" in said
    assert "≥ 10: **not reached**" in said and "Cycles 1: exit code 1 no" in said
    assert "| 0.06 | reached |" in said  # √(.005² − .004²)/√(.05² − .004²)
    assert all(r["label"] in said for r in ROWS.values()) and "| 256 |" in said


def test_crops_are_where_the_errors_are(tmp_path):
    error = np.zeros((80, 120), np.float32)
    error[10:20, 15:30], error[60:70, 90:100] = 1, 0.5
    found = crops.places([error], 20)
    assert len(found) == crops.CROPS
    for (y, x), (top, left) in zip(found, ((10, 15), (60, 90)), strict=False):
        assert y <= top + 5 <= y + 20 and x <= left + 5 <= x + 20
    paths = []
    for n in range(2):
        paths.append(tmp_path / f"{n}.png")
        pixels = oiio.ImageBuf(oiio.ImageSpec(120, 80, 3, oiio.UINT8))
        oiio.ImageBufAlgo.fill(pixels, (0.5 * n, 0.2, 0.1))
        pixels.write(str(paths[n]))
    crops.sheet(paths, [None, error], tmp_path / "sheet.png")
    sheet = oiio.ImageBuf(str(tmp_path / "sheet.png")).get_pixels(oiio.UINT8)
    assert sheet.shape[1] >= 240 and sheet.shape[0] > 80 * 4 and tuple(sheet[40, 10]) == (0, 51, 26)


def test_scenes_that_a_run_leaves_out_stay_in_the_tables(tmp_path):
    """If they are of the same size and frame; each keeps the samples of its own reference."""
    earlier = {"reference": 64, "rows": ROWS, "flight": {}, "failed": []}
    task = contest.Task(("room",), (64, 36))
    told = {"format": contest.FORMAT, "version": contest.VERSION, "machine": {}, "size": task.size, "frame": task.frame}
    contest.write(told | {"scenes": {"stage": earlier, "room": earlier}}, tmp_path)
    found = contest._earlier(task, tmp_path)
    assert found == {"stage": earlier}
    own = {"room": earlier | {"reference": 8}}
    said = contest.write(told | {"scenes": found | own}, tmp_path)
    assert said.index("## room") < said.index("has 8 samples") < said.index("## stage") < said.index("has 64 samples")
    assert contest._earlier(contest.Task(("room",), (64, 37)), tmp_path) == {}
    assert contest._earlier(contest.Task(("room",), (64, 36), frame=11), tmp_path) == {}
    assert contest._earlier(task, tmp_path / "nothing") == {}


def test_references_may_be_made_alone(monkeypatch, tmp_path):
    tasks = []
    monkeypatch.setattr(contest, "run", lambda task, out: tasks.append(task))
    assert cli.main(["contest", "--out", str(tmp_path), "--levels", "", "--samples", "", "--reference", "8"]) == 0
    assert tasks[0].ways() == [] and tasks[0].reference == 8 and tasks[0].scenes == contest.SCENES


# --- Cells, the command ----------------------------------------------------------------------------------------

def test_a_cell_that_fails_or_never_ends_says_so(tmp_path):
    for name, body, patience, word in (("bad", "echo no such scene; exit 3", 20, "no such scene"),
                                       ("slow", "sleep 60", 0.3, "not done after 0.3 s")):
        program = tmp_path / name
        program.write_text(f"#!/bin/sh\n{body}\n")
        program.chmod(0o755)
        cell = Cell("room", Way("CYCLES", samples=4, denoise=True), (64, 36), (10,))
        assert cells.run(cell, tmp_path, str(program), 1, patience) is None
        assert word in (cell.folder(tmp_path) / cells.ERROR).read_text()
        assert cell.folder(tmp_path).name == "cycles_4_denoised"


@pytest.mark.parametrize(("arguments", "word"), [
    (["--scenes", "room,cellar"], "cellar"), (["--size", "8x8"], "8x8"), (["--samples", "1,x"], "1,x"),
    (["--levels", "best"], "best"), (["--flight", "-1"], "--flight")])
def test_bad_usage_has_a_sentence(tmp_path, arguments, word):
    done = subprocess.run([sys.executable, "-m", "light_meshes.cli", "contest", "--out", tmp_path / "out", *arguments],
                          capture_output=True, text=True)
    assert done.returncode == 2 and word in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


@needs_blender
@pytest.mark.slow
def test_a_tiny_contest_end_to_end(tmp_path):
    """Times, errors, memory; run again, it renders nothing; a lost cell comes back. At Draft, to be quick."""
    task = contest.Task(("night_hall",), (64, 36), ("DRAFT",), (1, 4), 16, 10, 0)
    found = contest.run(task, tmp_path)["scenes"]["night_hall"]
    assert found["failed"] == []
    assert set(found["rows"]) == {"draft", *(f"cycles_{n}{d}" for n in (1, 4) for d in ("", "_denoised"))}
    for r in found["rows"].values():
        assert 0 < r["rmse"] < 1 and r["seconds"] > 0 and r["processor"] > 0 and 0 < r["edges"] < 1
        assert not sys.platform.startswith("linux") or r["memory"] > 1e8
    assert found["rows"]["cycles_4"]["rmse"] < found["rows"]["cycles_1"]["rmse"]
    assert "## night_hall" in (tmp_path / "contest.md").read_text()
    done = {p: p.stat().st_mtime_ns for p in tmp_path.rglob(cells.RESULT)}
    lost = Cell("night_hall", Way("CYCLES", samples=1), (64, 36), (10,)).folder(tmp_path) / cells.RESULT
    lost.unlink()
    again = contest.run(task, tmp_path)["scenes"]["night_hall"]
    assert {p for p in tmp_path.rglob(cells.RESULT) if done[p] != p.stat().st_mtime_ns} == {lost}
    assert again["rows"]["draft"] == found["rows"]["draft"]
    assert json.loads((tmp_path / "contest.json").read_text())["format"] == contest.FORMAT
    assert (tmp_path / "contest_64x36.png").read_bytes()[:4] == b"\x89PNG"


COUNT = """
import json, os, sys
sys.path.insert(0, sys.argv[1])
import bpy, make
for name in make.SCENES:
    make.make(sys.argv[2], [name])
    s = bpy.context.scene
    cards = sum(len(o.data.polygons) for o in s.objects if o.name.startswith("Crown") and name == "forest")
    lamps = [o.data for o in s.objects if o.type == "LIGHT"]
    first = s.camera.matrix_world.copy()
    s.frame_set(s.frame_end)
    print("@", json.dumps([name, len(lamps), cards, s.frame_end, s.camera.matrix_world != first,
                           sorted({lamp.light_meshes.softness for lamp in lamps})]), flush=True)
os._exit(0)
"""


@needs_blender
@pytest.mark.slow
def test_the_scenes_hold_what_the_contest_is_about(tmp_path):
    folder = Path(__file__).parents[2] / "blend_scenes" / "contest"
    done = subprocess.run([sys.executable, "-c", COUNT, folder, tmp_path], capture_output=True, text=True)
    found = {f[0]: f[1:] for f in (json.loads(line[2:]) for line in done.stdout.splitlines() if line.startswith("@"))}
    assert tuple(found) == contest.SCENES, done.stderr
    assert [found[name][0] for name in ("night_hall", "stage", "exhibition")] == [64, 300, 4096]
    assert found["forest"][1] == 100_000
    for lamps, _, frames, moves, softness in found.values():
        assert lamps > 0 and frames == 20 and moves and softness == ["SIZE"]
    assert all((tmp_path / f"{name}.blend").stat().st_size > 1e5 for name in contest.SCENES)
