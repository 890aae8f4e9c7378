"""Lets a Python program render: a scene that it described, or one that it read; and write the picture to a file.
`light_meshes` exports these functions.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from ..film import images
from ..picture import render as renderer
from ..scene import snapshot
from ..scene.description import IDENTITY, RGB, Scene
from ..scene.errors import SceneError
from ..scene.validation import checked
from ..support.text import quoted

StrPath = str | os.PathLike[str]


@dataclass(frozen=True)
class Picture(renderer.Result):
    """A finished picture: `passes` (arrays), `statistics`, `warnings`, and a way to a file."""

    to_rec709: tuple[RGB, RGB, RGB] = IDENTITY  # the scene's

    def save(self, path: StrPath) -> None:
        """Write the picture to a file: .exr with all passes, scene-linear float32; or .png with Combined, 8 bits in
        sRGB.

        The file appears only when it is complete. Raises SceneError if it cannot be written.
        """
        file = Path(path)
        images.check_place(file)
        if file.suffix.lower() == ".png" and "Combined" not in self.passes:
            raise SceneError(f"{file.name}: a .png shows the pass Combined, which was not rendered: ask for it, or "
                             "write an .exr")
        images.write(self.frame, file, self.to_rec709)


def render(scene: Scene, passes: Sequence[str] = ("Combined",), *, threads: int | None = None,
           progress: Callable[[float, str], None] = lambda fraction, stage: None,
           cancelled: Callable[[], bool] = lambda: False) -> Picture:
    """Check `scene`, render it into memory, and return the picture. The picture does not depend on the number of
    threads.

    passes: names from `PASSES`. threads: the number of threads to render with; None means one for each processor.
    progress(share, stage) is called with the part that is done, 0 to 1, and a sentence, from any of these threads.
    cancelled() is called often; if it returns True, Cancelled is raised. Raises SceneError if the scene is wrong, or
    one of the passes.
    """
    if isinstance(passes, str):
        raise SceneError(f"passes must be a list of names, not {quoted(passes)}")
    if threads is not None and (not isinstance(threads, int) or threads < 1):
        raise SceneError(f"threads are {quoted(threads)}; they must be a whole number from 1 up, or None")
    scene = checked(scene)
    result = renderer.render(scene, images.Framebuffer.create(scene, passes), threads=threads, progress=progress,
                             cancelled=cancelled)
    return Picture(**{f.name: getattr(result, f.name) for f in fields(result)}, to_rec709=scene.to_rec709)


def read_snapshot(path: StrPath) -> Scene:
    """Read and check a snapshot: its folder, or one of the scene files in it. Raises SceneError.

    If possible, arrays stay in their files, so the files must not change as long as the scene is in use.
    """
    return snapshot.read(Path(path))


def write_snapshot(scene: Scene, folder: StrPath) -> None:
    """Check `scene` and write it into `folder`, which is made if necessary. Raises SceneError, or OSError if it cannot
    be written.
    """
    snapshot.write(checked(scene), Path(folder))
