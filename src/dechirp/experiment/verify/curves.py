"""Curves behind the claims on detection and resolution, with those of theory."""

from collections.abc import Mapping

import numpy as np

from dechirp.core.values import value
from dechirp.experiment.verify import published, resolution, sensitivity
from dechirp.experiment.verify.looks import named
from dechirp.experiment.verify.reference_target import by_window


@value
class Curve:
    """Share of trials in which something was found, over what was varied."""

    name: str
    over: str
    """What was varied, with its unit."""
    x: tuple[float, ...]
    hits: tuple[int, ...]
    trials: tuple[int, ...]
    theory_x: tuple[float, ...] = ()
    theory: tuple[float, ...] = ()
    """Probability of theory at `theory_x`; empty where there is none."""


_SNR = "SNR in each sample, dB"
_APART = "separation, range bins"
_REACH_DB = 2.5  # of the curves of theory, on either side of what was measured


def curves(results: Mapping[str, np.ndarray]) -> tuple[Curve, ...]:
    """Detection by each window and by the report's rule, and resolution by each window."""
    found = [
        _against(named(window), trials, sensitivity.curve_of_theory(window))
        for window, trials in by_window(results).items()
    ]
    both = np.concatenate([results["report"], results["report at its limit"]])
    found.append(_against(published.RULE, both, sensitivity.report_curve()))
    for window in resolution.APART_BINS:
        name = f"two targets, {window}"
        trials = np.concatenate([results[name], results[f"{name}, curve"]])
        found.append(counted(named(window), _APART, trials))
    return tuple(found)


def counted(name: str, over: str, trials: np.ndarray) -> Curve:
    """Count the hits at each value; `trials` (n, 2): what was varied, and hit or not."""
    x, which = np.unique(trials[:, 0], return_inverse=True)
    return Curve(
        name=name,
        over=over,
        x=tuple(x.tolist()),
        hits=tuple(np.bincount(which, trials[:, 1]).astype(int).tolist()),
        trials=tuple(np.bincount(which).tolist()),
    )


def _against(name: str, trials: np.ndarray, theory: sensitivity.DetectionCurve) -> Curve:
    found = counted(name, _SNR, trials)
    fine = np.linspace(found.x[0] - _REACH_DB, found.x[-1] + _REACH_DB, 61)
    return Curve(
        name=name,
        over=_SNR,
        x=found.x,
        hits=found.hits,
        trials=found.trials,
        theory_x=tuple(fine.tolist()),
        theory=tuple(theory(fine).tolist()),
    )
