"""A rendered 3D view whose engine is slow, dies or hangs, as a script of a Blender with a window.

It prints lines "@story " + JSON, as viewport_story.py does; test_addon_viewport_troubles.py runs it.
"""

import math
import os
import signal
import sys
import time
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from viewport_tools import (
    bare,
    children,
    context,
    idle,
    log,
    mesh_object,
    play,
    rotate,
    same_as_fresh,
    space,
    tell,
    viewport,
    viewport_module,
)

SLOW_SECONDS = 1.0  # of a first picture
MOST_ROUNDS = 12  # in which the scene is made slower, until its first picture takes that long


def story():
    scene = bpy.context.scene
    bpy.data.lights["Light"].light_meshes.softness = 'SCENE'  # by nodes, of whose step and radius the line speaks
    scene.render.engine = 'LIGHT_MESHES'
    ball = bpy.data.objects["Cube"]
    big = mesh_object("Big", 200, 0.7, 0.05, location=(2.5, 0, 0))  # many triangles, on few of the picture's pixels
    big.hide_viewport = True
    rotate(0.3)
    yield lambda: True
    space().shading.type = 'RENDERED'
    yield lambda: viewport_module.viewports and viewport().pictures
    yield idle

    yield from quick(ball)
    yield from slow(scene, ball)
    yield from deaths(ball, big)
    yield from hangs(ball)
    yield from four_views(ball)


def first_after(change):
    """Carry out `change`, and wait for its first picture. Seconds until then."""
    view, since = viewport(), time.monotonic()
    before = view.pictures
    change()
    yield lambda: view.pictures > before
    return time.monotonic() - since


def shown_after(change):
    """Carry out `change`; wait until it is shown, and all that belongs to it."""
    yield from first_after(change)
    yield 0.1
    yield idle


def gaps(seconds, change, pictures=2):
    """Seconds that pass without a new picture, while `change` is called with the time all along. It ends when so many
    pictures have been seen, or so many seconds have passed.
    """
    view, begin = viewport(), time.monotonic()
    seen, last, found = view.pictures, begin, []
    while (now := time.monotonic()) < begin + seconds and len(found) < pictures:
        change(now - begin)
        if view.pictures != seen:
            found.append(now - last)
            seen, last = view.pictures, now
        yield 0.03
    return [*found, time.monotonic() - last]


def quick(ball):
    """Pictures that come at once are seen at once while something changes."""
    found = yield from gaps(3, lambda t: setattr(ball.location, "x", np.sin(t)), pictures=10)
    tell("quick", gaps=found)
    yield idle


def slow(scene, ball):
    """A scene whose first picture takes long, by rays that nobody needs. None of direct light, which is quick, comes
    before it.
    """
    viewport_module.DIRECT = False
    own = scene.light_meshes
    own.shadows, own.samples, own.light_samples = 'AREA_SAMPLING', 1, 16384
    scene.frame_start, scene.frame_end = 1, 1000

    def slower():
        """Twice as many rays, as far as they may be chosen; then twice as many lamps. Not more, as what follows takes
        several times as long as a first picture.
        """
        lamps = [ob for ob in scene.objects if ob.type == 'LIGHT']
        if own.light_samples < 65536:
            own.light_samples *= 2
            return
        for i in range(len(lamps)):
            lamp = bpy.data.objects.new("Lamp", bpy.data.objects["Light"].data)
            lamp.location = i % 8, 3 + i // 8, 5
            scene.collection.objects.link(lamp)

    took, rounds = 0.0, 0
    while took < SLOW_SECONDS:
        if (rounds := rounds + 1) > MOST_ROUNDS:
            raise TimeoutError(f"the first picture takes {took:.2f} s only, with {own.light_samples} rays to each of "
                               f"{sum(ob.type == 'LIGHT' for ob in scene.objects)} lamps")
        yield from first_after(slower)  # whose first picture comes may be the one before
        took = math.inf
        for _ in range(2):  # the machine may have been busy with others
            took = min(took, (yield from first_after(lambda: setattr(ball.location, "z", ball.location.z + 0.01))))
    tell("first picture", seconds=took, light_samples=own.light_samples)
    patience = 3 + 3 * took
    for name, change in {
        "dragging": lambda t: setattr(ball.location, "x", np.sin(t)),
        "turning": rotate,
        "both": lambda t: (rotate(t), setattr(ball.location, "x", np.sin(t))),
    }.items():
        tell(name, patience=patience, gaps=(yield from gaps(patience + 1, change)))
    # At the end of playback it is the last frame that is seen.
    ball.keyframe_insert("location", index=0, frame=1)
    ball.location.x += 20
    ball.keyframe_insert("location", index=0, frame=1000)
    with context():
        bpy.ops.screen.animation_play()
    found = yield from gaps(patience + 1, lambda t: None)
    with context():
        bpy.ops.screen.animation_play()
    tell("playback", patience=patience, gaps=found, frame=scene.frame_current)
    ball.animation_data_clear()
    own.shadows, own.light_samples = 'LIGHT_MESHES', 64
    ball.location = 0, 0, 0
    for ob in [ob for ob in scene.objects if ob.name.startswith("Lamp")]:
        bpy.data.objects.remove(ob)
    viewport_module.DIRECT = True
    yield from same_as_fresh("after all that")


def kill(how=signal.SIGKILL):
    for pid in children():
        os.kill(pid, how)


def deaths(ball, big):
    def turned():
        rotate(time.monotonic() % 6)

    def moved():
        ball.location.y += 0.1

    def larger():
        big.hide_viewport = not big.hide_viewport

    for name, change in {"turn": turned, "edit": moved, "large edit": larger}.items():
        for how in (signal.SIGKILL, signal.SIGTERM):
            old = children()
            kill(how)
            yield lambda: not viewport()._session.alive
            log.clear()
            yield from shown_after(change)
            tell(f"{name} after {how.name}", engines=len(children()), another=children() != old,
                 failed=viewport()._failed, outdated="drawn" in log[:log.index("put")])
    yield from same_as_fresh("after deaths")

    for _ in range(5):  # until one does not end its picture before it dies
        before = viewport().pictures
        moved()
        yield lambda: viewport()._unseen
        kill()
        yield lambda before=before: viewport().pictures > before
        yield 0.1
        yield idle
        if children():
            break
    tell("in the first picture", engines=len(children()), failed=viewport()._failed)
    big.hide_viewport = False
    yield 0.1
    yield idle
    for wait in (0.0, 0.02, 0.05):  # while it is exported, while files are written
        before = viewport().pictures
        big.data.vertices[0].co.z += 0.1
        big.data.update()
        yield wait
        kill(signal.SIGTERM)
        yield 0.3
        yield lambda before=before: viewport().pictures > before
        yield 0.1
        yield idle
    tell("in an export", engines=len(children()), failed=viewport()._failed)
    yield from same_as_fresh("after deaths at work")
    big.hide_viewport = True
    yield 0.1
    yield idle

    killed = set()

    def over():
        for pid in set(children()) - killed:
            os.kill(pid, signal.SIGKILL)
            killed.add(pid)
        return viewport()._failed
    moved()
    yield over
    text = viewport()._text
    yield 1.0
    tell("again and again", killed=len(killed), text=text, engines=len(children()), bare=bare(viewport()._picture))
    yield from shown_after(turned)
    tell("at last", engines=len(children()), failed=viewport()._failed)


def hangs(ball):
    """Edits go on while the engine is silent."""
    os.environ["LIGHT_MESHES_TIMEOUT"] = "5"
    old = children()
    kill(signal.SIGSTOP)
    before, since, edits = viewport().pictures, time.monotonic(), 0
    while viewport().pictures == before and time.monotonic() < since + 60:
        ball.location.y -= 0.01
        edits += 1
        yield 0.03
    tell("hangs", seconds=time.monotonic() - since, edits=edits, another=children() != old,
         shown=viewport().pictures > before)
    yield from same_as_fresh("after a hang")


def four_views(ball):
    with context():
        bpy.ops.screen.region_quadview()
    views = viewport_module.viewports
    yield lambda: len(views) == 4 and all(v.pictures for v in views)
    yield lambda: not any(v._exporting or v._waits for v in views)
    old = set(children())
    kill()
    yield lambda: not old & set(children())
    before = {v: v.pictures for v in views}
    ball.location.x += 0.1
    yield lambda: all(v.pictures > before[v] for v in views)
    yield lambda: not any(v._exporting or v._waits for v in views)
    tell("four views", engines=len(children()), failed=[v._failed for v in views], texts=[v._text for v in views])


play(story)
