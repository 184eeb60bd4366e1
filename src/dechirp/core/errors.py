"""Every error raised on purpose, and the shape of its message.

DechirpError
    InvalidSetting   a value that cannot work (also a ValueError)
    InvalidFile      a settings file, or an option, with mistakes: all of them at once
    RecordingError   a file that is not the recording it should be
    NotEnoughMemory  a job that would not fit, refused before it starts
"""

from dechirp.core.values import value


@value
class Mistake:
    """One thing that is wrong: where, what was got, what is needed, how to mend it."""

    setting: str
    got: str
    need: str
    fix: str
    file: str | None = None
    line: int | None = None
    """Counted from 1."""
    column: int | None = None
    """Counted from 1."""

    def __str__(self) -> str:
        place = ":".join(str(part) for part in (self.file, self.line, self.column) if part)
        where = f"{place}: {self.setting}" if place else self.setting
        text = f"{where} is {self.got}, but must be {self.need}. {self.fix}"
        if text.isprintable():
            return text
        # Names of files and foreign bytes may hold anything, a terminal's commands among them.
        return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


class DechirpError(Exception):
    """Base of them all: `except DechirpError` catches what the package meant to say."""

    def __init__(self, *mistakes: Mistake) -> None:
        super().__init__("\n".join(str(mistake) for mistake in mistakes))
        self.mistakes = mistakes

    def __reduce__(self) -> tuple[object, ...]:
        # Subclasses take other arguments; a worker process hands back the mistakes.
        return _restored, (type(self), self.mistakes)


def _restored(kind: type[DechirpError], mistakes: tuple[Mistake, ...]) -> DechirpError:
    error = kind.__new__(kind)
    DechirpError.__init__(error, *mistakes)
    return error


class InvalidSetting(DechirpError, ValueError):
    """A setting that cannot work; `setting` reads `Class.field_with_unit`."""

    def __init__(self, setting: str, *, got: object, need: str, fix: str) -> None:
        super().__init__(Mistake(setting=setting, got=str(got), need=need, fix=fix))


class InvalidFile(DechirpError):
    """A settings file or an option that does not say what it should."""


class RecordingError(DechirpError):
    """A recording that cannot be read as it is, or as it was said to be."""

    def __init__(self, file: object, *, got: object, need: str, fix: str) -> None:
        super().__init__(
            Mistake(setting="recording", got=str(got), need=need, fix=fix, file=str(file))
        )


class NotEnoughMemory(DechirpError, MemoryError):
    """A job that would not fit into memory, refused before it starts."""

    def __init__(self, what: str, *, needed_bytes: float, available_bytes: float, fix: str) -> None:
        super().__init__(
            Mistake(
                setting=what,
                got=f"{needed_bytes / 2**30:.3g} GiB of memory",
                need=f"at most {available_bytes / 2**30:.3g} GiB, what is free now",
                fix=fix,
            )
        )
