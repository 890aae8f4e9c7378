"""Measure how long the rendered 3D view of a real Blender takes to its first picture, for the .blend files of a folder.

    python tests/support/first_pictures.py FOLDER [NAME …]

It needs Xvfb, and LIGHT_MESHES_BLENDER or a `blender` on the PATH. Each file is opened in a Blender of its own, with a
view of 826 × 600 pixels or so. Printed are, from the moment when the shading is set to Rendered: the seconds until the
engine is asked and until the first picture is drawn, and the processor seconds of Blender and of the engine until then.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SETTLED = 4.0  # seconds until Blender has drawn its window, and an engine waits
PATIENCE = 120.0  # seconds until the first picture
ROOT = Path(__file__).parents[2]


def inside(file: str) -> None:
    """What Blender does."""
    import bpy

    addon = next(name[:-len(".viewport")] for name in sys.modules if name.endswith("light_meshes.viewport"))
    module, screen, session = (sys.modules[f"{addon}.{name}"] for name in ("viewport", "screen", "session"))
    told: dict[str, float] = {}
    draw, send = screen.Picture.draw, session.Session.send

    def drawn(self, *rest):
        fresh = self._pixels is not None
        draw(self, *rest)
        if fresh:
            told.setdefault("drawn", time.perf_counter())

    def sent(self, *command, **more):
        told.setdefault("asked", time.perf_counter())
        told["number"] = send(self, *command, **more)
        return told["number"]

    def engine(of):
        fields = Path(f"/proc/{of._process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    screen.Picture.draw, session.Session.send = drawn, sent
    bpy.ops.wm.open_mainfile(filepath=file, load_ui=False)
    bpy.context.scene.render.engine = 'LIGHT_MESHES'
    space = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == 'VIEW_3D').spaces.active
    space.region_3d.view_perspective = 'CAMERA'

    def begin():
        told["engine"] = engine(session._waiting[0])
        told["began"], told["busy"] = time.perf_counter(), time.process_time()
        space.shading.type = 'RENDERED'
        bpy.app.timers.register(look, first_interval=0.01)

    def look():
        now = time.perf_counter()
        if "drawn" not in told and now - told["began"] < PATIENCE:
            return 0.01
        found = {name: round(told[name] - told["began"], 3) for name in ("asked", "drawn") if name in told}
        (view,) = module.viewports
        found |= {"blender": round(time.process_time() - told["busy"], 2),
                  "engine": round(engine(view._session) - told["engine"], 2)}
        print("@first " + json.dumps(found), flush=True)
        bpy.ops.wm.quit_blender()
        return None

    bpy.app.timers.register(begin, first_interval=SETTLED, persistent=True)


def environment(folder: Path, blender: str) -> dict[str, str]:
    """Return an environment in which Blender has this checkout's add-on enabled, and uses nothing of the user's."""
    (folder / "extensions").mkdir()
    (folder / "tmp").mkdir()
    (folder / "extensions" / "light_meshes").symlink_to(ROOT / "addon")
    found = os.environ | {"BLENDER_USER_RESOURCES": str(folder / "user"), "LIGHT_MESHES_PYTHON": sys.executable,
                          "TMPDIR": str(folder / "tmp"), "LIBGL_ALWAYS_SOFTWARE": "1"}
    enable = ("import bpy, addon_utils; "
              f"bpy.context.preferences.extensions.repos.new(name='dev', module='dev', "
              f"custom_directory={str(folder / 'extensions')!r}, remote_url=''); "
              "addon_utils.enable('bl_ext.dev.light_meshes', default_set=True); bpy.ops.wm.save_userpref()")
    subprocess.run([blender, "-b", "--python-expr", enable], env=found, check=True, stdout=subprocess.DEVNULL)
    return found


def main(folder: str, *names: str) -> None:
    blender = os.environ.get("LIGHT_MESHES_BLENDER") or shutil.which("blender")
    assert blender, "set LIGHT_MESHES_BLENDER, or put `blender` on the PATH"
    reading, writing = os.pipe()
    screen = subprocess.Popen(["Xvfb", "-displayfd", str(writing), "-screen", "0", "1280x1000x24", "+extension", "GLX",
                               "-nolisten", "tcp"], pass_fds=[writing], stderr=subprocess.DEVNULL)
    os.close(writing)
    try:
        with os.fdopen(reading) as f, tempfile.TemporaryDirectory() as temporary:
            display = f.readline().strip()
            own = environment(Path(temporary), blender) | {"DISPLAY": f":{display}"}
            for file in sorted(Path(folder).glob("*.blend")):
                if names and file.stem not in names:
                    continue
                log = Path(temporary) / "log.txt"
                with log.open("w") as out:
                    subprocess.run([blender, "--window-geometry", "0", "0", "1000", "700", "-P", __file__],
                                   env=own | {"FIRST_PICTURE_OF": str(file.resolve())}, stdout=out, stderr=out,
                                   timeout=PATIENCE + 120)
                text = log.read_text(errors="replace")
                found = [json.loads(line[7:]) for line in text.splitlines() if line.startswith("@first ")]
                print(f"{file.stem:12}", found[0] if found else text[-2000:], flush=True)
    finally:
        screen.terminate()
        screen.wait()


if __name__ == "__main__":
    if "FIRST_PICTURE_OF" in os.environ:
        inside(os.environ["FIRST_PICTURE_OF"])
    else:
        main(*sys.argv[1:])
