"""What is wrong with what was given: the scene, or how the command was called."""

from __future__ import annotations

from ..support.text import shown


class SceneError(ValueError):
    """Bad input: the message says what was wrong, where, and what to do. In one line, whatever names it quotes."""

    def __str__(self) -> str:
        return shown(super().__str__())[:600]


class UsageError(Exception):
    """The command was called wrongly: exit code 2."""
