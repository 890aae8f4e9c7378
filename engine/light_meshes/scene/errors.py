"""Errors in the input: in the scene, or in the arguments of the command."""

from __future__ import annotations

from ..support.text import shown


class SceneError(ValueError):
    """The input is wrong. The message says what is wrong, where, and what to do; it is one line, whatever names it
    quotes.
    """

    def __str__(self) -> str:
        return shown(super().__str__())[:600]


class UsageError(Exception):
    """The arguments of the command are wrong; the exit code is 2."""
