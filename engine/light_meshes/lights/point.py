"""POINT: shines alike in all directions. What arrives of it: `point.h`."""

from __future__ import annotations

from .kind import LightKind, radius, sphere

KIND = LightKind(sphere, radius)
