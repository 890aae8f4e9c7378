"""What could not be translated: one sentence a kind, with the names of all that it happened to."""

NAMED = 3  # of many, so many are named


class ExportError(Exception):
    """The scene cannot be rendered as it is; the message says what to change."""


class Report:
    """Collects warnings in order. What is said of several materials (or objects, …) becomes one sentence."""

    def __init__(self) -> None:
        self.lights: list[tuple | None] = []  # which they are, in the snapshot's order; None: their size has no effect
        # (kind, sentence) → name of what it is said of → what was used instead there.
        self._found: dict[tuple[str, str], dict[str, str]] = {}
        self.mattes: dict[str, set[str]] = {}  # the names that each kind of Cryptomatte has

    def warn(self, sentence: str, kind: str = "", name: str = "", used: str = "") -> None:
        """`kind` and `name` say of what, such as "Material" and its name; `used`: the value used instead."""
        self._found.setdefault((kind, sentence), {}).setdefault(name, used)

    def add(self, other: "Report") -> None:
        """Say what `other` says, too."""
        for (kind, sentence), names in other._found.items():
            for name, used in names.items():
                self.warn(sentence, kind, name, used)

    @property
    def sentences(self) -> list[str]:
        """All that is to be said, each kind once."""
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
    """The items as a sentence lists them."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


def shown(value: object) -> str:
    """A socket's value as a sentence shows it."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, int | float):
        return f"{value:.4g}"
    return f"({', '.join(f'{v:.4g}' for v in list(value)[:3])})"  # type: ignore[call-overload]
