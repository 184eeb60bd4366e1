"""CFAR factors of all detectors with a closed form, on numbers and arrays."""

from collections.abc import Callable
from functools import partial
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import (
    broadcast_arguments,
    check_finite_array,
    check_integer,
    check_probabilities,
)
from dechirp.core.errors import InvalidSetting
from dechirp.theory.cfar import (
    cell_averaging_factor,
    greatest_of_factor,
    ordered_statistic_factor,
    smallest_of_factor,
)

__all__ = ["cfar_factor"]

CfarKind = Literal["cell-averaging", "greatest-of", "smallest-of", "ordered-statistic"]


def cfar_factor(
    false_alarm_probability: ArrayLike,
    n_training: ArrayLike,
    kind: CfarKind = "cell-averaging",
    *,
    rank: int | None = None,
    n_summed: int = 1,
) -> np.ndarray:
    """Return the ratio of the threshold to the noise estimate of a CFAR detector.

    In independent cells of square-law noise, see `theory.cfar`; `dechirp.cfar.cfar_threshold`
    applies it to a map, with windows and zero padding as well.

    Parameters
    ----------
    false_alarm_probability : array
        For the cell under test.
    n_training : array of int
        Training cells, those of both halves together; broadcast with the probability.
    kind : str
        Noise estimate: the mean of all cells, the larger or the smaller of the means of both
        halves, or the `rank`-th smallest cell.
    rank : int, optional
        For an ordered statistic only: 1 for the smallest cell.
    n_summed : int
        Powers that are summed in each cell: receivers, or pulses.

    Returns
    -------
    array
        Ratios of powers, in the shape to which both arrays broadcast.

    Raises
    ------
    InvalidSetting
        If a probability is not between 0 and 1, a number of cells not whole and positive, an odd
        number has halves, the kind is unknown, or the rank missing or superfluous.
    """
    pfa, cells = broadcast_arguments(
        false_alarm_probability=check_probabilities(
            "false_alarm_probability", false_alarm_probability
        ),
        n_training=check_finite_array("n_training", n_training),
    )
    factor = _factor_function(kind, rank)

    def compute(single_pfa: float, n_cells: float) -> float:
        whole = int(n_cells) if n_cells == int(n_cells) else n_cells
        check_integer("n_training", whole, at_least=1)
        return factor(float(single_pfa), n_training=whole, n_summed=n_summed)

    return np.vectorize(compute, otypes=[float])(pfa, cells)


def _factor_function(kind: CfarKind, rank: int | None) -> Callable[..., float]:
    functions: dict[CfarKind, Callable[..., float]] = {
        "cell-averaging": cell_averaging_factor,
        "greatest-of": greatest_of_factor,
        "smallest-of": smallest_of_factor,
    }
    is_ordered = kind == "ordered-statistic"
    if is_ordered != (rank is not None):
        raise InvalidSetting(
            "rank",
            value="missing" if is_ordered else f"{rank}, with {kind}",
            expected="a rank for ordered-statistic, and for no other kind",
            fix="give 3/4 of the training cells" if is_ordered else "leave it out",
        )
    if rank is not None:
        return partial(ordered_statistic_factor, rank=rank)
    if kind not in functions:
        raise InvalidSetting(
            "kind", value=kind, expected=" or ".join(get_args(CfarKind)), fix="choose one of them"
        )
    return functions[kind]
