"""Whatever happens to the engine, the artist gets one readable sentence, no wrong picture, and the next render works.

Each fault is caused for real, in a separate process.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import light_meshes
import pytest
from faults import go, python


@pytest.fixture
def run(tmp_path):
    """(script) → the lines it printed that begin with a word in capitals; temporary files are in tmp_path."""
    def run(script, **environment):
        lines, run.output = go(tmp_path, script, **environment)
        return lines
    return run


def test_child_killed_in_mid_render(run):
    lines = run("""
        slow()
        first_progress(lambda: os.kill(child(), signal.SIGKILL))
        render()
        fast()
        render()
        leave()
    """)
    assert re.fullmatch(r"ERROR Error: The Light Meshes engine has ended unexpectedly .*signal 9.* False", lines[0])
    assert lines[1] == "RESULT {'FINISHED'} True"


def test_child_that_hangs(run):
    lines = run("""
        slow()
        first_progress(lambda: os.kill(child(), signal.SIGSTOP))
        start = time.monotonic()
        render()
        print("TOOK", time.monotonic() - start < 20)
        fast()
        render()
        leave()
    """, LIGHT_MESHES_TIMEOUT="3")
    assert "does not answer" in lines[0] and lines[0].endswith("False")
    assert lines[1:] == ["TOOK True", "RESULT {'FINISHED'} True"]


@pytest.mark.parametrize("how", ["SIGKILL", "SIGTERM", "SIGSTOP"])
def test_child_that_died_or_hung_between_renders(run, how):
    """The next render has another one, at once: silence counts from the engine's last word."""
    lines = run(f"""
        fast()
        render()
        old = session._sessions["render"]._process
        os.environ["LIGHT_MESHES_TIMEOUT"] = "5"
        os.kill(old.pid, signal.{how})
        time.sleep(5.5)
        start = time.monotonic()
        render()
        print("TOOK", time.monotonic() - start < 20, child() != old.pid, old.wait(5) < 0)
        leave()
    """)
    ended = how != "SIGTERM"  # which it obeys
    assert lines == ["RESULT {'FINISHED'} True"] * 2 + [f"TOOK True True {ended}"]


def test_a_child_is_not_silent_while_blender_does_not_listen(run):
    """As when Blender computes for long, or the machine sleeps: what was said meanwhile is read first."""
    lines = run("""
        fast()
        render()
        os.environ["LIGHT_MESHES_TIMEOUT"] = "5"
        one = session._sessions["render"]
        one._heard -= 100
        one._looked -= 100
        for _ in range(30):
            assert one.poll(0.04) is None
        print("HEARD", one.usable)
        leave()
    """)
    assert lines[1] == "HEARD True"


def test_missing_python(run):
    lines = run("""
        fast()
        os.environ["LIGHT_MESHES_PYTHON"] = "/no/such/python"
        render()
        os.environ["LIGHT_MESHES_PYTHON"] = sys.executable
        render()
        leave()
    """)
    assert "/no/such/python cannot be run" in lines[0] and lines[0].endswith("False")
    assert lines[1] == "RESULT {'FINISHED'} True"


def test_missing_kernels(run, tmp_path):
    """An engine that was not built: what it says is what the artist reads."""
    package = Path(light_meshes.__file__).parent
    shutil.copytree(package, tmp_path / "unbuilt" / "light_meshes",
                    ignore=shutil.ignore_patterns("__pycache__", "kernels*"))
    lines = run("""
        fast()
        render()
        leave()
    """, PYTHONPATH=str(tmp_path / "unbuilt"))
    assert lines[0].startswith("ERROR Error: Light Meshes: the engine's kernels cannot be loaded")
    assert "To have them built, install" in lines[0] and lines[0].endswith("False")


def test_missing_package(run, tmp_path):
    bare = tmp_path / "bare"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", bare], check=True)
    python = next(p for p in (bare / "bin" / "python", bare / "Scripts" / "python.exe") if p.exists())
    lines = run("""
        fast()
        render()
        leave()
    """, LIGHT_MESHES_PYTHON=str(python))
    assert "has no package 'light_meshes'" in lines[0] and "pip install light-meshes" in lines[0]
    assert lines[0].endswith("False")


def test_what_is_no_python(run):
    """A program that says nothing and ends."""
    lines = run("""
        fast()
        render()
        leave()
    """, LIGHT_MESHES_PYTHON="/bin/true")
    assert re.search(r"ERROR Error: The Light Meshes engine cannot start \(exit code 0\) False", lines[0])


def test_the_engines_own_error(run):
    """An error that the engine reports is told; the log's end is on the console."""
    lines = run("""
        fast()
        bpy.data.objects["Camera"].data.clip_end = 1e30
        bpy.data.objects["Cube"].matrix_world[0][3] = float("nan")
        render()
        leave()
    """)
    assert lines[0].startswith(("ERROR Error: Light Meshes:", "RESULT"))  # a clear message or a correct picture


def test_a_fault_of_the_addon_is_told(run):
    lines = run("""
        fast()
        session.Session.new_folder = lambda self: 1 / 0
        render()
        leave()
    """)
    assert re.match(r"ERROR Error: The Light Meshes add-on failed: ZeroDivisionError.* False", lines[0])
    assert "Traceback" in run.output


def test_interrupt(run):
    """Ctrl-C with Python as the host: quick, no picture, and the same engine renders on."""
    lines = run("""
        slow()
        times = []
        def interrupt():
            def later():
                time.sleep(0.3)
                times.append(time.monotonic())
                os.kill(os.getpid(), signal.SIGINT)
            threading.Thread(target=later).start()
        see = first_progress(interrupt)
        render()
        print("TOOK", time.monotonic() - times[0])
        time.sleep(1)
        print("ALIVE", see.process.poll() is None, session._sessions["render"]._process is see.process)
        fast()
        render()
        leave()
    """)
    assert "interrupted" in lines[0] and lines[0].endswith("False")
    assert float(lines[1].split()[1]) < 0.5  # 0.05 on an idle machine
    assert lines[2:] == ["ALIVE True True", "RESULT {'FINISHED'} True"]


def test_a_child_that_does_not_confirm_is_ended(run):
    """A stopped child cannot confirm a cancelled render: Blender goes on at once, the child is ended behind it."""
    lines = run("""
        slow()
        times = []
        def stop_and_interrupt():
            os.kill(child(), signal.SIGSTOP)
            times.append(time.monotonic())
            threading.Timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        see = first_progress(stop_and_interrupt)
        render()
        print("TOOK", time.monotonic() - times[0])
        fast()
        render()
        time.sleep(2)
        print("GONE", see.process.poll() is not None)
        leave()
    """)
    assert float(lines[1].split()[1]) < 1
    assert lines[2:] == ["RESULT {'FINISHED'} True", "GONE True"]


def test_without_unregister_no_child_remains(run):
    """The end of Python ends the engine."""
    lines = run("""
        fast()
        render()
        print("CHILD", child(), flush=True)
        import atexit
        atexit._run_exitfuncs()
        os._exit(0)
    """)
    with pytest.raises(ProcessLookupError):
        os.kill(int(lines[1].split()[1]), 0)


def test_garbage_on_the_engines_output(run, tmp_path):
    """Lines that are no events go to the log; what did not end its line does not hide the event behind it."""
    lines = run("""
        fast()
        render()
        print("LOGGED", session._sessions["render"].log.count("no event"), "times")
        leave()
    """, LIGHT_MESHES_PYTHON=python(tmp_path, r"""
printf 'no event\n\377\376\000 no event\n[]\n{"event": []}\n{"event": "no event"}\n{"event": 1e999}\nno event'
exec {python} "$@"
"""))
    assert lines == ["RESULT {'FINISHED'} True", "LOGGED 3 times"]


@pytest.mark.parametrize("event", [
    '{"event": "ready", "folder": "%s"}', '{"event": "done", "id": [1]}',
    '{"event": "progress", "id": 1, "fraction": NaN, "stage": ""}'])
def test_an_event_that_is_not_as_it_should_be(run, tmp_path, event):
    """It is refused at once, and a folder that is no engine's is not taken for one, nor removed."""
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "work.txt").write_text("years of it")
    event = event.replace("%s", str(tmp_path / "precious"))
    lines = run("""
        fast()
        render()
        os.environ["LIGHT_MESHES_PYTHON"] = sys.executable
        render()
        leave()
    """, LIGHT_MESHES_PYTHON=python(tmp_path, f"echo '{event}'; exec sleep 60"))
    assert re.fullmatch(r"ERROR Error: Light Meshes: the engine's event '\w+' is not as .* the same release\? False",
                        lines[0])
    assert lines[1] == "RESULT {'FINISHED'} True"
    assert (tmp_path / "precious" / "work.txt").read_text() == "years of it"


def test_a_program_that_talks_without_end(run, tmp_path):
    lines = run("""
        fast()
        render()
        leave()
    """, LIGHT_MESHES_PYTHON=python(tmp_path, r"exec yes | tr -d '\n'"), LIGHT_MESHES_TIMEOUT="2")
    assert "does not answer any more: it was silent for 2 seconds" in lines[0] and lines[0].endswith("False")
