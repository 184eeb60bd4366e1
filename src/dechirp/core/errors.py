"""Exceptions of the package and the form of their messages.

DechirpError
    InvalidSetting   an invalid value (also a ValueError)
    InvalidFile      a settings file or an option with mistakes, all reported together
    RecordingError   an unreadable recording, or one that contradicts its description
    NotEnoughMemory  a job that exceeds the free memory, refused before it starts
"""

from dataclasses import dataclass

_MAX_QUOTED_CHARACTERS = 300
"""Largest length of a setting's name and its value in a message; both may quote a foreign file."""
_MAX_ADVICE_CHARACTERS = 1000
"""Largest length of the accepted values and of the fix, which may list all settings of a class."""


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """Mistake of a user: the setting, its value, the accepted values, and how to fix it.

    Longer texts keep their start and their end: files may contain values of any length.
    """

    setting: str
    value: str
    expected: str
    fix: str
    file: str | None = None
    line: int | None = None
    """Counted from 1."""
    column: int | None = None
    """Counted from 1."""

    def __post_init__(self) -> None:
        for name, max_characters in (
            ("setting", _MAX_QUOTED_CHARACTERS),
            ("value", _MAX_QUOTED_CHARACTERS),
            ("expected", _MAX_ADVICE_CHARACTERS),
            ("fix", _MAX_ADVICE_CHARACTERS),
        ):
            text = shorten_middle(getattr(self, name), max_characters)
            object.__setattr__(self, name, text)

    def __str__(self) -> str:
        place = ":".join(str(part) for part in (self.file, self.line, self.column) if part)
        # An invalid option --set is its own place.
        where = f"{place}: {self.setting}" if place not in ("", self.setting) else self.setting
        text = f"{where}: {self.value}; expected {self.expected}; {self.fix}"
        if text.isprintable():
            return text
        # File names and foreign bytes may contain control sequences of a terminal.
        return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


class DechirpError(Exception):
    """Base class: `except DechirpError` catches every error that the package raises on purpose."""

    def __init__(self, *mistakes: Mistake) -> None:
        super().__init__("\n".join(str(mistake) for mistake in mistakes))
        self.mistakes = mistakes

    def __reduce__(self) -> tuple[object, ...]:
        # Constructors of subclasses take other arguments; pickling restores the mistakes.
        return _unpickle_error, (type(self), self.mistakes)


def _unpickle_error(kind: type[DechirpError], mistakes: tuple[Mistake, ...]) -> DechirpError:
    error = kind.__new__(kind)
    DechirpError.__init__(error, *mistakes)
    return error


class InvalidSetting(DechirpError, ValueError):
    """Invalid value of a setting or an argument; `setting` reads `Class.field_with_unit`."""

    def __init__(
        self, setting: str, *, value: object, expected: str, fix: str, file: str | None = None
    ) -> None:
        super().__init__(
            Mistake(setting=setting, value=str(value), expected=expected, fix=fix, file=file)
        )


class InvalidFile(DechirpError):
    """Settings file or command-line option with mistakes."""


class RecordingError(DechirpError):
    """Recording that cannot be read, or that contradicts its description."""

    def __init__(self, file: object, *, value: object, expected: str, fix: str) -> None:
        super().__init__(
            Mistake(
                setting="recording", value=str(value), expected=expected, fix=fix, file=str(file)
            )
        )


class NotEnoughMemory(DechirpError, MemoryError):
    """Job that exceeds the free memory, refused before it starts."""

    def __init__(self, what: str, *, needed_bytes: float, available_bytes: float, fix: str) -> None:
        super().__init__(
            Mistake(
                setting=what,
                value=f"{needed_bytes / 2**30:.3g} GiB of memory",
                expected=f"at most {available_bytes / 2**30:.3g} GiB, the free memory",
                fix=fix,
            )
        )


def shorten_middle(text: str, max_characters: int) -> str:
    """Replace the middle of a text by " ... " if it is longer than `max_characters`."""
    if len(text) <= max_characters:
        return text
    n_tail = max_characters // 3
    return f"{text[: max_characters - n_tail - 5]} ... {text[len(text) - n_tail :]}"


def quote_for_message(text: str) -> str:
    """Quote a text in a message: one printable line of at most 60 characters."""
    line = " ".join(text.split())
    line = line if line and line.isprintable() else repr(text)
    return line if len(line) <= 60 else f"{line[:57]}..."
