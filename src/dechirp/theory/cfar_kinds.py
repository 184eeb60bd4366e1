"""CFAR factors of all detectors with a closed form, on numbers and arrays."""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    broadcast_arguments,
    check_probabilities,
    check_real_array,
    check_whole_numbers,
)
from dechirp.core.elementwise import scalar_results
from dechirp.core.errors import InvalidSetting
from dechirp.theory.cfar import (
    cell_averaging_factor,
    greatest_of_factor,
    ordered_statistic_factor,
    smallest_of_factor,
)
from dechirp.theory.cfar_trimmed_mean import trimmed_mean_factor
from dechirp.theory.training_cells import (
    DEFAULT_N_LARGEST,
    DEFAULT_N_SMALLEST,
    DEFAULT_RANK,
    cell_count_from_setting,
)

__all__ = ["cfar_factor"]

CfarKind = Literal[
    "cell-averaging", "greatest-of", "smallest-of", "ordered-statistic", "trimmed-mean"
]
# Settings of each kind with their defaults, shares of the training cells.
_CELL_COUNTS_OF_KIND: dict[str, dict[str, float]] = {
    "cell-averaging": {},
    "greatest-of": {},
    "smallest-of": {},
    "ordered-statistic": {"rank": DEFAULT_RANK},
    "trimmed-mean": {"n_smallest": DEFAULT_N_SMALLEST, "n_largest": DEFAULT_N_LARGEST},
}


@check_argument_types
@scalar_results
def cfar_factor(
    false_alarm_probability: ArrayLike,
    n_training: ArrayLike,
    kind: CfarKind = "cell-averaging",
    *,
    n_summed: ArrayLike = 1,
    rank: ArrayLike | None = None,
    n_smallest: ArrayLike | None = None,
    n_largest: ArrayLike | None = None,
) -> np.ndarray:
    """Return the ratio of the threshold to the noise estimate of a CFAR detector.

    In independent cells of square-law noise, see `theory.cfar`; `dechirp.cfar.cfar_threshold`
    applies it to a map, with windows and zero padding as well.

    Parameters
    ----------
    false_alarm_probability : array
        For the cell under test.
    n_training : array of int
        Training cells, those of both halves together.
    kind : str
        Noise estimate: the mean of all cells, the larger or the smaller of the means of both
        halves, the `rank`-th smallest cell, or the mean without the smallest and largest cells.
    n_summed : array of int
        Powers that are summed in each cell: receivers, or pulses. 1 for a trimmed mean.
    rank : array of int, optional
        For an ordered statistic only: a number of cells, 1 for the smallest cell. By default that
        of `dechirp.cfar.OrderedStatistic()`, 0.75 n_training, rounded up.
    n_smallest, n_largest : array of int, optional
        For a trimmed mean only: numbers of cells left out. By default those of
        `dechirp.cfar.TrimmedMean()`, 0 and 0.25 n_training, rounded up.

    Returns
    -------
    array
        Ratios of powers, in the shape to which all arrays broadcast.

    Raises
    ------
    InvalidSetting
        If a probability is not between 0 and 1, a number of cells not whole and positive, an odd
        number has halves, the kind is unknown, or a setting belongs to another kind.
    """
    counts = {
        "n_training": check_whole_numbers("n_training", n_training, at_least=1),
        "n_summed": check_whole_numbers("n_summed", n_summed, at_least=1),
    }
    optional = {"rank": rank, "n_smallest": n_smallest, "n_largest": n_largest}
    for name, numbers in optional.items():
        if numbers is not None:
            _check_no_share(name, numbers)
            counts[name] = check_whole_numbers(name, numbers, at_least=0)
    if np.all(counts["n_summed"] == 1):
        del counts["n_summed"]
    _check_settings_of_kind(kind, counts)
    for name, share in _CELL_COUNTS_OF_KIND[kind].items():
        counts.setdefault(name, cell_count_from_setting(counts["n_training"], share))
    pfa, *arrays = broadcast_arguments(
        false_alarm_probability=check_probabilities(
            "false_alarm_probability", false_alarm_probability
        ),
        **counts,
    )
    functions: dict[str, Callable[..., float]] = {
        "cell-averaging": cell_averaging_factor,
        "greatest-of": greatest_of_factor,
        "smallest-of": smallest_of_factor,
        "ordered-statistic": ordered_statistic_factor,
        "trimmed-mean": trimmed_mean_factor,
    }

    def compute(single_pfa: float, *numbers: int) -> float:
        whole = {name: int(number) for name, number in zip(counts, numbers, strict=True)}
        return functions[kind](float(single_pfa), **whole)

    return np.vectorize(compute, otypes=[float])(pfa, *arrays)


def _check_no_share(name: str, numbers: ArrayLike) -> None:
    """Raise `InvalidSetting` for shares of the training cells, which detectors accept."""
    values = check_real_array(name, numbers)
    shares = values[(values > 0) & (values < 1)]
    if shares.size:
        raise InvalidSetting(
            name,
            value=shares.flat[0],
            expected="a number of cells",
            fix=f"multiply the share by n_training, and round it up; only the {name} of a detector"
            " of dechirp.cfar may be a share",
        )


def _check_settings_of_kind(kind: CfarKind, settings: Mapping[str, np.ndarray]) -> None:
    if kind not in _CELL_COUNTS_OF_KIND:
        raise InvalidSetting(
            "kind",
            value=kind,
            expected=" or ".join(_CELL_COUNTS_OF_KIND),
            fix="choose one of them; two-step has no factor of its own: it is that of"
            " greatest-of for lines of equal length, and dechirp.cfar.cfar_threshold applies it",
        )
    # A trimmed mean has no closed form for summed powers.
    summed = [] if kind == "trimmed-mean" else ["n_summed"]
    accepted = ["n_training", *summed, *_CELL_COUNTS_OF_KIND[kind]]
    for name in settings.keys() - set(accepted):
        raise InvalidSetting(
            name,
            value=f"{settings[name]}, with {kind}",
            expected=f"{' and '.join(accepted)} with {kind}",
            fix="leave it out",
        )
