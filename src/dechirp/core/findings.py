"""What a user should know about a result that is nevertheless a result."""

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Literal, Self

from dechirp.core.displayed import Table
from dechirp.core.errors import Mistake
from dechirp.core.values import value


@value
class Finding:
    """A requirement that is not met, or physics that surprises: a sentence in four parts."""

    level: Literal["note", "warning", "error"]
    setting: str
    got: str
    need: str
    fix: str

    @classmethod
    def of(cls, mistake: Mistake, *, level: Literal["warning", "error"]) -> Self:
        """Tell a mistake of what is a result all the same, but for its place in a file."""
        return cls(
            level=level,
            setting=mistake.setting,
            got=mistake.got,
            need=mistake.need,
            fix=mistake.fix,
        )

    def __str__(self) -> str:
        return f"{self.setting}: {self.got}; needs {self.need}. {self.fix}"


def findings(found: Iterable[Finding]) -> Table:
    """What there is to know of a result, as a notebook shows it."""
    return Table("Findings", [(one.level, str(one)) for one in found])


class PhysicsWarning(UserWarning):
    """Legal physics that surprises: an echo that aliases, folds or arrives late.

    Made of a `Finding`, whose sentence it says.
    """


@contextmanager
def heard() -> Iterator[list[Finding]]:
    """Hear what is warned of inside: findings are in the list afterwards, all else is passed on."""
    found: list[Finding] = []
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        yield found
    for one in warned:
        (said,) = getattr(one.message, "args", ("",))[:1] or ("",)
        if isinstance(said, Finding):
            found.append(said)
        else:
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
