"""Witnesses: foreign answers in published files, and their comparison with results of dechirp.

The files are not part of dechirp. A witness reads them from its folder under the folder that
`DECHIRP_WITNESS_DATA` names.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_real_array
from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family
from dechirp.core.values import frozen_dataclass


@frozen_dataclass
class Comparison:
    """One number of a witness beside the number of dechirp."""

    quantity: str
    theirs: float
    ours: float
    unit: str
    """SI unit, dB, or 1 for ratios and counts."""
    tolerance: float
    """Largest allowed difference to the worse side, in the unit."""
    basis: str
    """Where the tolerance comes from."""
    cause: str = ""
    """Known cause of a difference beyond the tolerance."""
    relation: Literal["equal", "at least", "at most"] = "equal"
    """What ours has to be: theirs within the tolerance, or better than it on one side."""
    answer: Literal["independent", "own"] = "independent"
    """Origin of theirs: numbers that other people published, or that dechirp's developers computed
    from the published files: by a plain decoding, a published method or their own reading of the
    scene."""

    @property
    def difference(self) -> float:
        """Ours minus theirs."""
        return self.ours - self.theirs

    @property
    def excess(self) -> float:
        """Difference to the worse side over its tolerance; a number passes up to 1."""
        worse = {
            "equal": abs(self.difference),
            "at least": max(-self.difference, 0.0),
            "at most": max(self.difference, 0.0),
        }[self.relation]
        if not math.isfinite(self.difference):
            return math.inf
        if self.tolerance == 0:
            return math.inf if worse > 0 else 0.0
        return worse / self.tolerance

    @property
    def passed(self) -> bool:
        """True if both numbers are finite and ours has the relation to theirs."""
        return self.excess <= 1


@check_argument_types
def compare_arrays(
    quantity: str,
    theirs: ArrayLike,
    ours: ArrayLike,
    *,
    unit: str,
    basis: str,
    absolute: float = 0.0,
    relative: float = 0.0,
    cause: str = "",
    answer: Literal["independent", "own"] = "independent",
) -> Comparison:
    """Return the comparison of the two elements that exceed their tolerance most.

    The tolerance of an element is `absolute` plus `relative` times the magnitude of theirs.

    Parameters
    ----------
    quantity : str
        Name of what is compared.
    theirs, ours : array_like
        Real values of the witness and of the package, in equal shapes, one or more.
    unit : str
        Unit of the values.
    basis : str
        Basis of the tolerance.
    absolute, relative : float
        Parts of the tolerance: in the unit, and as a fraction of theirs.
    cause : str
        Known cause of a difference.
    answer : "independent" or "own"
        Origin of theirs: published by others, or computed by the developers of dechirp.

    Raises
    ------
    InvalidSetting
        If the arrays are no real numbers, are empty or differ in shape.
    """
    theirs_flat, ours_flat = (
        np.ravel(check_real_array(f"{side} of {quantity}", values, may_be_empty=True))
        for side, values in (("theirs", theirs), ("ours", ours))
    )
    if np.shape(theirs) != np.shape(ours) or theirs_flat.size == 0:
        raise InvalidSetting(
            f"theirs and ours of {quantity}",
            value=f"arrays {np.shape(theirs)} and {np.shape(ours)}",
            expected="arrays of the same shape, with one element or more",
            fix="compare elements in pairs",
        )
    tolerance = absolute + relative * np.abs(theirs_flat)
    excess = np.abs(ours_flat - theirs_flat) / np.maximum(tolerance, np.finfo(float).tiny)
    worst = int(np.argmax(np.where(np.isnan(excess), np.inf, excess)))
    return Comparison(
        quantity=quantity,
        theirs=float(theirs_flat[worst]),
        ours=float(ours_flat[worst]),
        unit=unit,
        tolerance=float(tolerance[worst]),
        basis=basis,
        cause=cause,
        answer=answer,
    )


class Witness(Family):
    """Base class of the sets of foreign answers, one file each."""

    group: ClassVar[str] = "dechirp.witness"
    folder: ClassVar[str]
    """Folder of the files, within that of all witnesses."""
    source: ClassVar[str]
    """Who published the files, with the revision."""
    licence: ClassVar[str]

    @abstractmethod
    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Yield one comparison for each number; raise `FileNotFoundError` if a file is missing."""
