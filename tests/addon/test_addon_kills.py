"""Processes end at random moments: engines are killed, renders are cancelled, and of two Blenders one is killed."""

import os
import re
import signal
import subprocess
import sys
import time

from faults import PRELUDE, go, names, running


def test_twenty_engines_killed_at_random_moments(tmp_path):
    """From their start to their end: each time the picture, or a sentence and no picture. Then a render as ever."""
    lines, _ = go(tmp_path, """
        import random
        fast()
        own.shadows = 'LIGHT_MESHES'
        render()  # so that the disk has been read
        session.discard()
        start = time.monotonic()
        render()
        seconds = 1.2 * (time.monotonic() - start)
        session.discard()
        moments = random.Random(6)

        def kill(process, wait):
            time.sleep(wait)
            process.kill()

        for n in range(20):
            engine = session.current()
            killer = threading.Thread(target=kill, args=(engine._process, moments.uniform(0, seconds)))
            killer.start()
            render()
            killer.join()
            engine._process.wait()
        render()
        leave()
    """, timeout=300)
    assert len(lines) == 23
    picture, killed = "RESULT {'FINISHED'} True", "The Light Meshes engine (cannot start|has ended unexpectedly)"
    sentence = rf"ERROR Error: {killed} \(killed by signal 9\)\. The system may have run out of memory False"
    assert lines[0] == lines[1] == lines[-1] == picture
    assert all(line == picture or re.fullmatch(sentence, line) for line in lines), lines
    assert sum(line != picture for line in lines) > 5, lines


def test_fifty_cancelled_renders(tmp_path):
    """At random moments: their engine goes on, if it confirms soon, with nothing of them in its folder."""
    lines, _ = go(tmp_path, """
        import random
        fast()
        own.shadows = 'LIGHT_MESHES'
        render()
        engines = {child()}
        slow()
        moments = random.Random(6)
        for n in range(50):
            timer = threading.Timer(moments.uniform(0.01, 0.2), os.kill, (os.getpid(), signal.SIGINT))
            timer.start()
            try:
                render()
                timer.join()
            except KeyboardInterrupt:  # it came when Python had the word
                print("EARLY or late")
            engine = session._sessions["render"]
            with engine._changed:
                engine._changed.wait_for(lambda: engine._closed or not engine._unfinished, 10)
            engines.add(child())
        print("ENGINES", len(engines))
        fast()
        render()
        print("LEFT", [p.name for p in session._sessions["render"].folder.iterdir()])
        leave()
    """, timeout=300)
    cancelled = lines[1:-3]
    assert set(cancelled) <= {"ERROR Error: The render was interrupted False", "EARLY or late"}
    assert len(cancelled) == 50 and cancelled.count("EARLY or late") < 10
    assert int(lines[-3].split()[1]) < 25  # 1 on an idle machine
    assert lines[-2:] == ["RESULT {'FINISHED'} True", "LEFT []"]


def test_two_blenders_at_once(tmp_path):
    """One is killed in mid render: its engine and its folder go, and the other's picture is as if it were alone."""
    (tmp_path / "other").mkdir()
    other = subprocess.Popen(
        [sys.executable, "-c", PRELUDE + "slow()\nfirst_progress(lambda: print('BEGUN', flush=True))\nrender()",
         tmp_path / "other" / "scene.blend", tmp_path / "other" / "picture.png"],
        env=os.environ | {"TMPDIR": str(tmp_path / "other")}, stdout=subprocess.PIPE, text=True)
    try:
        assert any(line.startswith("BEGUN") for line in other.stdout)
        before = names(tmp_path / "other")
        assert len(before) == 2 and len(running(tmp_path / "other")) == 2  # the file and the engine's folder
        lines, _ = go(tmp_path, f"""
            import OpenImageIO
            def pixels():
                render()
                return OpenImageIO.ImageBuf(sys.argv[2]).get_pixels()
            fast()
            both = pixels()
            os.kill({other.pid}, signal.SIGKILL)
            print("SAME", (pixels() == both).all(), (pixels() == both).all(), both[..., :3].max() > 0)
            leave()
        """)
        assert lines == ["RESULT {'FINISHED'} True"] * 3 + ["SAME True True True"]
        assert other.wait(10) == -signal.SIGKILL
        end = time.monotonic() + 10
        while (names(tmp_path / "other") - {"scene.blend"} or running(tmp_path / "other")) and time.monotonic() < end:
            time.sleep(0.05)
        assert names(tmp_path / "other") == {"scene.blend"} and not running(tmp_path / "other")
    finally:
        other.kill()
        other.stdout.close()
        other.wait()
