"""How the echoes of a scene are summed: by which kernel, how exactly, and when they begin."""

from typing import Literal

import numpy as np

from dechirp.core.checks import number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value

_CHOICES = {
    "kernel": ("auto", "direct", "product", "nonuniform"),
    "late": ("held", "onset", "tail"),
}

# What single precision reaches: the sum of two roundings and the images of the transforms.
FINEST = {"direct": 1e-9, "product": 1e-6, "nonuniform": 2e-6}


@value
class Engine:
    """Choices about the sum of echoes; the cube is the same for all, within the tolerance."""

    kernel: Literal["auto", "direct", "product", "nonuniform"] = "auto"
    """Which sums; auto: the one that a model of their costs predicts to be fastest."""
    tolerance: float | None = None
    """Error of the echoes over their size, both root mean square over a frame; none: 1e-5 in
    single precision, 1e-9 in double, which the direct kernel alone reaches."""
    late: Literal["held", "onset", "tail"] = "held"
    """Samples taken before an echo arrives hold it all the same, or nothing (onset), or what is
    left in the air of the previous chirp's echo (tail)."""

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            chosen = getattr(self, name)
            if not (isinstance(chosen, str) and chosen in choices):
                raise InvalidSetting(
                    f"Engine.{name}",
                    got=chosen,
                    need=f"one of {', '.join(choices)}",
                    fix="Choose one.",
                )
        if self.tolerance is None:
            return
        number("Engine.tolerance", self.tolerance, at_least=FINEST["direct"], at_most=0.1)
        finest = FINEST.get(self.kernel, 0.0)
        if self.tolerance < finest:
            raise InvalidSetting(
                "Engine.tolerance",
                got=self.tolerance,
                need=f"at least {finest:g} for the {self.kernel} kernel: it sums in single"
                " precision",
                fix="Take the direct kernel, or auto.",
            )

    def tolerance_of(self, dtype: np.dtype) -> float:
        """The tolerance, or what goes with the precision of the samples.

        A kernel that was chosen and cannot do better gives what it can.
        """
        if self.tolerance is not None:
            return self.tolerance
        usual = 1e-5 if dtype.itemsize <= np.dtype(np.complex64).itemsize else FINEST["direct"]
        return max(usual, FINEST.get(self.kernel, 0.0))
