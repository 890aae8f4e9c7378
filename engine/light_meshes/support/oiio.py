"""OpenImageIO, which is loaded when it is first used: a picture without image files needs none of it."""

from __future__ import annotations

from typing import Any


class _Library:
    """Stands for the module OpenImageIO, which it imports when an attribute is first used."""

    def __getattr__(self, name: str) -> Any:
        import OpenImageIO

        found = getattr(OpenImageIO, name)
        setattr(self, name, found)
        return found


oiio: Any = _Library()
