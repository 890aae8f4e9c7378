"""What could not be translated: one sentence each, said once."""


class ExportError(Exception):
    """The scene cannot be rendered as it is; the message says what to change."""


class Report:
    """Collects warnings, in order and without repetition."""

    def __init__(self) -> None:
        self._sentences: dict[str, None] = {}

    def warn(self, sentence: str) -> None:
        self._sentences[sentence] = None

    @property
    def sentences(self) -> list[str]:
        return list(self._sentences)
