"""Engine settings: kernel, tolerance, and treatment of late echoes."""

from typing import Literal

import numpy as np

from dechirp.core.checks import check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass

_CHOICES = {
    "kernel": ("auto", "direct", "low-rank", "nufft"),
    "late": ("held", "onset", "tail"),
}

# Limits of single precision: rounding in two sums, and image responses of the transforms.
MIN_TOLERANCE = {"direct": 1e-9, "low-rank": 1e-6, "nufft": 2e-6}


@frozen_dataclass
class Engine:
    """Settings of the echo summation; the cube is the same for all, within the tolerance."""

    kernel: Literal["auto", "direct", "low-rank", "nufft"] = "auto"
    """Summation method; auto chooses the one with the least predicted time."""
    tolerance: float | None = None
    """Error of the echoes relative to their size, both root mean square over a frame; none: 1e-5
    in single precision, 1e-9 in double, which only the direct kernel achieves."""
    late: Literal["held", "onset", "tail"] = "held"
    """Content of samples taken before an echo arrives: the echo, as if the ramp had begun
    earlier (held), nothing (onset), or the remaining echo of the previous chirp (tail)."""

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            choice = getattr(self, name)
            if not (isinstance(choice, str) and choice in choices):
                raise InvalidSetting(
                    f"Engine.{name}",
                    value=choice,
                    expected=f"one of {', '.join(choices)}",
                    fix="choose one",
                )
        if self.tolerance is None:
            return
        check_number(
            "Engine.tolerance", self.tolerance, at_least=MIN_TOLERANCE["direct"], at_most=0.1
        )
        least = MIN_TOLERANCE.get(self.kernel, 0.0)
        if self.tolerance < least:
            raise InvalidSetting(
                "Engine.tolerance",
                value=self.tolerance,
                expected=f"at least {least:g} for the {self.kernel} kernel, which uses single"
                " precision",
                fix="choose the direct kernel, or auto",
            )

    def effective_tolerance(self, dtype: np.dtype) -> float:
        """Return the tolerance, or the default of the precision of the samples.

        The default of an explicitly chosen kernel is at least the best that it achieves.
        """
        if self.tolerance is not None:
            return self.tolerance
        default = (
            1e-5 if dtype.itemsize <= np.dtype(np.complex64).itemsize else MIN_TOLERANCE["direct"]
        )
        return max(default, MIN_TOLERANCE.get(self.kernel, 0.0))
