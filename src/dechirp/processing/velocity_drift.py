r"""Phase drift of static echoes, and the error of velocities that it causes.

Standard errors of velocities are those of noise. The phases of a radar drift too, by temperature,
supply or vibration of its mount: a drift of phi over a frame of duration T shifts a velocity by
phi lambda / (4 pi T), which the noise at other velocities does not show. Velocities v_i of static
echoes do, which are 0 but for their shifts and noise of standard error sigma_i. Two estimates of
the variance of the shifts are compared with what noise alone gives; the larger one counts.

* All echoes have a shift u in common. Then

  .. math:: E[v_i v_j] = E[u^2], \quad i \neq j,

  so the mean of products over pairs and frames, weighted by 1 / (sigma_i sigma_j)^2, estimates the
  variance, whatever the noise is. A slow target has a velocity of its own, which does not correlate
  with that of others. A motion of the radar itself does, and looks alike.
* Each echo has a shift of its own. Then the median of v_i^2 / (sigma_i^2 + s^2) is that of a
  chi-squared variate, 0.455. The median leaves out slow targets, unless most echoes are.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.text import format_number
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.radar import Radar

# Largest velocity of static echoes, in cells: noise at 20 dB has 0.04, and a cell is 2 pi of phase.
_MAX_STATIC_CELLS = 0.1
# Strongest static echoes of a frame that are compared. Their tones are estimated together, so that
# the errors of near ones correlate: at least three cells apart.
_MAX_ECHOES = 4
_MIN_DISTANCE_CELLS = 3.0
# Sum of products v_i v_j / (sigma_i sigma_j) over n pairs, and median of v_i^2 / sigma_i^2 over n
# echoes, that noise exceeds less often than once in a thousand recordings: products have tails of
# exp(-x) and the variance 1, and the median of squares the standard deviation 1.06 / sqrt(n).
_MIN_PRODUCT, _MIN_PRODUCT_STDS = 8.0, 4.0
_MEDIAN_SQUARE, _MEDIAN_STD, _MIN_MEDIAN_STDS = 0.4549, 1.06, 5.0
_MIN_ECHOES = 4


def velocity_drift_m_per_s(columns: Mapping[str, np.ndarray], radar: Radar) -> float:
    """Return the RMS shift of the velocities of static echoes; 0 if noise explains them.

    `columns` are those of `core.detection_columns`, of all frames.
    """
    if not radar.frame.can_measure_velocity:
        return 0.0
    echoes_by_frame = _strongest_static_echoes(columns, radar)
    velocity, std = columns["velocity"], columns["velocity_std"]
    common = _common_variance(
        [(velocity[rows], std[rows]) for rows in echoes_by_frame if len(rows) > 1]
    )
    rows = np.concatenate([*echoes_by_frame, np.zeros(0, int)])
    return float(np.sqrt(max(common, _median_variance(velocity[rows], std[rows]))))


def _strongest_static_echoes(columns: Mapping[str, np.ndarray], radar: Radar) -> list[np.ndarray]:
    """Return the rows of the static echoes with the smallest errors in each frame."""
    frame, std = radar.frame, columns["velocity_std"]
    limit_m_per_s = _MAX_STATIC_CELLS * frame.velocity_resolution_m_per_s
    rows = np.flatnonzero((abs(columns["velocity"]) <= limit_m_per_s) & (std > 0))
    rows = rows[np.lexsort((std[rows], columns["frame"][rows]))]
    starts = np.flatnonzero(np.diff(columns["frame"][rows])) + 1
    min_distance_m = _MIN_DISTANCE_CELLS * frame.chirp.range_resolution_m
    return [
        _select_separate_echoes(in_frame, columns["range"], min_distance_m)
        for in_frame in np.split(rows, starts)
    ]


def _common_variance(echoes: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Return the variance of a shift that the echoes of a frame have in common.

    Velocities and standard errors of each frame.
    """
    score, n_pairs, weighted_sum, weight_sum = 0.0, 0, 0.0, 0.0
    for velocity, std in echoes:
        first, second = np.triu_indices(len(velocity), 1)
        product, product_std = velocity[first] * velocity[second], std[first] * std[second]
        score += float(np.sum(product / product_std))
        n_pairs += product.size
        weighted_sum += float(np.sum(product / product_std**2))
        weight_sum += float(np.sum(1 / product_std**2))
    if score <= _MIN_PRODUCT + _MIN_PRODUCT_STDS * np.sqrt(n_pairs):
        return 0.0
    return max(weighted_sum / weight_sum, 0.0)


def _median_variance(velocity: np.ndarray, std: np.ndarray) -> float:
    """Return the variance of shifts that make the median of squared velocities that of noise."""
    n_echoes = velocity.size
    if n_echoes < _MIN_ECHOES:
        return 0.0

    def excess(variance: float) -> float:
        # The lower middle of an even number: two slow targets of four are no drift.
        squares = velocity**2 / (std**2 + variance)
        return float(np.quantile(squares, 0.5, method="lower")) - _MEDIAN_SQUARE

    if excess(0.0) <= _MIN_MEDIAN_STDS * _MEDIAN_STD / np.sqrt(n_echoes):
        return 0.0
    low, high = 0.0, float(np.max(velocity**2)) / _MEDIAN_SQUARE
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high


def _select_separate_echoes(
    rows: np.ndarray, range_m: np.ndarray, min_distance_m: float
) -> np.ndarray:
    """Return the first rows, in their order, whose ranges lie apart."""
    selected: list[int] = []
    for row in rows:
        if all(abs(range_m[row] - range_m[other]) >= min_distance_m for other in selected):
            selected.append(int(row))
        if len(selected) == _MAX_ECHOES:
            break
    return np.array(selected, int)


def widen_velocity_errors(
    columns: Mapping[str, np.ndarray], drift_m_per_s: float
) -> dict[str, np.ndarray]:
    """Return the columns with such a shift in the standard errors of velocities."""
    return {**columns, "velocity_std": np.hypot(columns["velocity_std"], drift_m_per_s)}


def velocity_drift_findings(drift_m_per_s: float, radar: Radar) -> tuple[Finding, ...]:
    """Return a note if the velocities of static echoes are shifted."""
    if drift_m_per_s == 0:
        return ()
    frame = radar.frame
    wavelength_m = SPEED_OF_LIGHT / frame.chirp.mean_sampled_frequency_hz
    phase_mrad = 1e3 * 4 * np.pi * drift_m_per_s * frame.duration_s / wavelength_m
    return (
        Finding(
            level="note",
            setting="recording",
            value=f"the strongest static echoes have velocities of {drift_m_per_s:.2g} m/s RMS,"
            f" more than noise causes: a drift of {format_number(phase_mrad, 2)} mrad of phase over"
            " a frame, or a motion of radar and room; the standard errors of all velocities"
            " contain it",
            expected="static echoes at 0 m/s within their noise",
            fix="no action needed; longer frames reduce such a shift",
        ),
    )
