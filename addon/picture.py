"""The picture in Blender: the engine's framebuffer → Blender's render result."""

from pathlib import Path

import numpy as np

from . import passes
from .session import EngineError


class Picture:
    """The render result of one view layer, and the framebuffer that fills it."""

    def __init__(self, engine, size: tuple[int, int], depsgraph) -> None:
        view_layer = depsgraph.view_layer_eval
        self.passes = passes.wanted(depsgraph.scene, view_layer)
        self._engine, self._size = engine, size
        # With a border, Blender counts from the border's corner.
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
        """Show what is done."""
        self._copy()
        self._engine.update_result(self._result)

    def end(self, metadata: dict[str, str]) -> None:
        """Hand over what is done, for good; metadata: field → value of the files that Blender writes."""
        self._copy()
        self._engine.end_result(self._result)
        if metadata:
            result = self._engine.get_result()
            for field, value in metadata.items():
                result.stamp_data_add_field(field, value)

    def give_up(self) -> None:
        """Nothing more will come. What was shown stays in sight; handing more over would keep the artist waiting."""
        self._engine.end_result(self._result, cancel=True)

    def _copy(self) -> None:
        width, height = self._size
        for p in self.passes:
            if p.name in self._arrays:
                pixels = np.broadcast_to(self._arrays[p.name], (height, width, p.channels))
                for rect in (r for r in self._result.layers[0].passes if r.name == p.name):  # one a view
                    # foreach_set: assigning `rect` takes a hundred times as long.
                    rect.rect.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
