"""OpenImageIO, which is loaded when it is first used: a picture without image files needs none of it."""

from __future__ import annotations

from typing import Any


class _Library:
    """Has everything that the module OpenImageIO has."""

    def __getattr__(self, name: str) -> Any:
        import OpenImageIO

        found = getattr(OpenImageIO, name)
        setattr(self, name, found)
        return found


oiio: Any = _Library()
