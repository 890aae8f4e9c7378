"""The picture in Blender: copies the engine's framebuffer into Blender's render result."""

from pathlib import Path

import numpy as np

from . import passes
from .session import EngineError


class Picture:
    """The render result of one view layer, and the framebuffer from which it is filled."""

    def __init__(self, engine, size: tuple[int, int], depsgraph) -> None:
        view_layer = depsgraph.view_layer_eval
        self.passes = passes.wanted(depsgraph.scene, view_layer)
        self._engine, self._size = engine, size
        # With a render border, Blender counts from the corner of the border.
        self._result = engine.begin_result(0, 0, *size, layer=view_layer.name)
        self._arrays: dict[str, np.ndarray] = {}

    def open(self, folder: Path) -> None:
        """Map the framebuffer that the engine made."""
        width, height = self._size
        for p in self.passes:
            array = np.load(folder / f"{p.engine_name}.npy", mmap_mode="r")
            if array.shape[:2] != (height, width):
                raise EngineError(f"The Light Meshes engine renders {array.shape[1]}×{array.shape[0]} pixels, "
                                  f"Blender wants {width}×{height}")
            self._arrays[p.name] = array

    def show(self) -> None:
        """Show the part that is done."""
        self._copy()
        self._engine.update_result(self._result)

    def end(self, metadata: dict[str, str]) -> None:
        """Hand the finished picture to Blender. `metadata` holds field → value for the files that Blender writes."""
        self._copy()
        self._engine.end_result(self._result)
        if metadata:
            result = self._engine.get_result()
            for field, value in metadata.items():
                result.stamp_data_add_field(field, value)

    def give_up(self) -> None:
        """End without further results. The part that was shown stays visible; to hand over more would keep the artist
        waiting.
        """
        self._engine.end_result(self._result, cancel=True)

    def _copy(self) -> None:
        width, height = self._size
        for p in self.passes:
            if p.name in self._arrays:
                pixels = np.broadcast_to(self._arrays[p.name], (height, width, p.channels))
                # there is one for each view
                for rect in (r for r in self._result.layers[0].passes if r.name == p.name):
                    # foreach_set is used because assigning to `rect` takes a hundred times as long.
                    rect.rect.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
