"""Render the same .blend with Cycles, in a separate Blender process that waits for requests
(`blend_scenes/direct_light.py`).
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ..frontends.blend import MARK, blender, environment
from ..scene.errors import SceneError
from .scenes import Case, blend_folder, sized


class Cycles:
    """A Blender process that renders with Cycles, on as many threads as there are cores. Use it in a `with`
    statement.
    """

    def __init__(self) -> None:
        script = str(blend_folder() / "direct_light.py")
        if importlib.util.find_spec("bpy"):
            command = [sys.executable, script]
        elif found := blender():
            command = [found, "-b", "--factory-startup", "-P", script]
        else:
            raise SceneError("Cycles needs Blender: install the 'blender' extra or put a blender on the PATH")
        self.version = ""
        self._folder = tempfile.TemporaryDirectory(prefix="light-meshes-")
        self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                       stderr=subprocess.DEVNULL, text=True, errors="replace", env=environment())

    def __enter__(self) -> Cycles:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._child.stdin is not None
        self._child.stdin.close()
        try:
            self._child.wait(10)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._folder.cleanup()

    def render(self, case: Case, size: int, samples: int, seed: int = 0, picture: Path | None = None,
               denoise: bool = False, window: tuple[float, ...] | None = None) -> dict[str, Any]:
        """Render a picture of size² pixels, with rays through the centres of the pixels, with OpenImageDenoise if
        `denoise`. window: (left, bottom, right, top) of the part that is rendered, 0 to 1; None: all. Returns the
        seconds `sampling`, with the denoiser's, and `whole`.
        """
        camera = sized(case.scene, size).camera
        request = {"file": str(case.file), "lights": case.sizes, "power": case.power, "width": camera.width,
                   "height": camera.height, "samples": samples, "seed": seed, "denoise": denoise, "window": window,
                   "picture": str(picture) if picture else None}
        assert self._child.stdin is not None and self._child.stdout is not None
        print(json.dumps(request), file=self._child.stdin, flush=True)
        for line in self._child.stdout:
            _, mark, text = line.partition(MARK)
            if mark:
                answer: dict[str, Any] = json.loads(text)
                self.version = answer["version"]
                return answer
        raise SceneError(f"Blender ended with code {self._child.wait()} while Cycles rendered {case.file.name}")

    def picture(self, case: Case, size: int, samples: int, seed: int = 0, denoise: bool = False,
                window: tuple[float, ...] | None = None) -> NDArray[np.float32]:
        """Return linear RGB, shape (height, width, 3), with the bottom row first."""
        path = Path(self._folder.name) / "picture.exr"
        self.render(case, size, samples, seed, path, denoise, window)
        file = oiio.ImageInput.open(str(path))
        if file is None:
            raise SceneError(f"Cycles' picture of {case.file.name} cannot be read: {oiio.geterror()}")
        pixels = file.read_image(oiio.FLOAT)
        file.close()
        assert pixels is not None
        return np.ascontiguousarray(pixels[::-1, :, :3])
