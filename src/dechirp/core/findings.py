"""What a user should know about a result that is nevertheless a result."""

from typing import Literal

from dechirp.core.values import value


@value
class Finding:
    """A requirement that is not met, or physics that surprises: a sentence in four parts."""

    level: Literal["note", "warning", "error"]
    setting: str
    got: str
    need: str
    fix: str

    def __str__(self) -> str:
        return f"{self.setting}: {self.got}; needs {self.need}. {self.fix}"


class PhysicsWarning(UserWarning):
    """Legal physics that surprises: an echo that aliases, folds or arrives late.

    Made of a `Finding`, whose sentence it says.
    """
