"""Measured and theoretical curves of the claims on detection and resolution."""

from collections.abc import Mapping

import numpy as np

from dechirp.certificate import published, resolution, sensitivity
from dechirp.certificate.reference_trials import window_label
from dechirp.certificate.shared_trials import snr_limit_trials_by_window
from dechirp.core.values import frozen_dataclass
from dechirp.report.labels import SNR_PER_SAMPLE_LABEL


@frozen_dataclass
class MeasuredCurve:
    """Proportion of successful trials over a varied quantity, with its theoretical curve."""

    name: str
    x_label: str
    """Axis label of the varied quantity, with its unit."""
    x: tuple[float, ...]
    hits: tuple[int, ...]
    trials: tuple[int, ...]
    theory_x: tuple[float, ...] = ()
    theory: tuple[float, ...] = ()
    """Theoretical probability at `theory_x`; empty without a theory."""


_SEPARATION_LABEL = "Separation (range bins)"
_THEORY_MARGIN_DB = 2.5  # of the theoretical curve beyond the measured points on either side


def build_detection_and_resolution_curves(
    results: Mapping[str, np.ndarray],
) -> tuple[MeasuredCurve, ...]:
    """Return the detection curves of all windows and the report's rule, and resolution curves."""
    measured_curves = [
        _detection_curve_with_theory(
            window_label(window), trials, sensitivity.theoretical_curve(window)
        )
        for window, trials in snr_limit_trials_by_window(results).items()
    ]
    report_trials = np.concatenate([results["report"], results["report at its limit"]])
    measured_curves.append(
        _detection_curve_with_theory(
            published.RULE_NAME, report_trials, sensitivity.report_rule_curve()
        )
    )
    for window in resolution.REQUIRED_SEPARATION_BINS:
        name = f"two targets, {window}"
        trials = np.concatenate([results[name], results[f"{name}, curve"]])
        measured_curves.append(
            count_hits_per_value(window_label(window), _SEPARATION_LABEL, trials)
        )
    return tuple(measured_curves)


def count_hits_per_value(name: str, x_label: str, trials: np.ndarray) -> MeasuredCurve:
    """Count the hits at each value; `trials` (n, 2) holds the varied value and the hit (0 or 1)."""
    x, inverse = np.unique(trials[:, 0], return_inverse=True)
    return MeasuredCurve(
        name=name,
        x_label=x_label,
        x=tuple(x.tolist()),
        hits=tuple(np.bincount(inverse, trials[:, 1]).astype(int).tolist()),
        trials=tuple(np.bincount(inverse).tolist()),
    )


def _detection_curve_with_theory(
    name: str, trials: np.ndarray, theory: sensitivity.DetectionCurve
) -> MeasuredCurve:
    measured = count_hits_per_value(name, SNR_PER_SAMPLE_LABEL, trials)
    theory_x = np.linspace(
        measured.x[0] - _THEORY_MARGIN_DB, measured.x[-1] + _THEORY_MARGIN_DB, 61
    )
    return MeasuredCurve(
        name=name,
        x_label=SNR_PER_SAMPLE_LABEL,
        x=measured.x,
        hits=measured.hits,
        trials=measured.trials,
        theory_x=tuple(theory_x.tolist()),
        theory=tuple(theory(theory_x).tolist()),
    )
