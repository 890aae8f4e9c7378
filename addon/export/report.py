"""Collect what could not be translated: one sentence for each kind, with the names of everything concerned."""

NAMED = 3  # how many names a sentence has at most


class ExportError(Exception):
    """The scene cannot be rendered; the message says what to change."""


class Report:
    """Collects warnings in order. The same sentence about several materials (or objects, …) becomes one warning."""

    def __init__(self) -> None:
        # the identity of each light, in the order of the snapshot; None if its size has no effect
        self.lights: list[tuple | None] = []
        # (kind, sentence) → name of the thing → the value that was used instead
        self._found: dict[tuple[str, str], dict[str, str]] = {}
        self.mattes: dict[str, set[str]] = {}  # the names for each kind of Cryptomatte

    def warn(self, sentence: str, kind: str = "", name: str = "", used: str = "") -> None:
        """Add a warning. `kind` and `name` say what it is about, such as "Material" and its name; `used` is the value
        that was used instead.
        """
        self._found.setdefault((kind, sentence), {}).setdefault(name, used)

    def add(self, other: "Report") -> None:
        """Add the warnings of `other`."""
        for (kind, sentence), names in other._found.items():
            for name, used in names.items():
                self.warn(sentence, kind, name, used)

    @property
    def sentences(self) -> list[str]:
        """Return all warnings, each kind once."""
        return [_said(kind, sentence, names) for (kind, sentence), names in self._found.items()]


def _said(kind: str, sentence: str, names: dict[str, str]) -> str:
    if len(names) == 1:
        (name, used), = names.items()
        about = f"{kind} '{name}': " if kind else ""
        return f"{about}{sentence}{f': {used}' if used else ''}"
    shown = [f"'{name}' ({used})" if used else f"'{name}'" for name, used in list(names.items())[:NAMED]]
    more = [f"{len(names) - NAMED} more"] if len(names) > NAMED else []
    return f"In {len(names)} {kind.lower()}s: {sentence}: {listed([*shown, *more])}"


def listed(items: list[str]) -> str:
    """Join the items to a list in a sentence."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


def shown(value: object) -> str:
    """Format the value of a socket for a sentence."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, int | float):
        return f"{value:.4g}"
    return f"({', '.join(f'{v:.4g}' for v in list(value)[:3])})"  # type: ignore[call-overload]
