"""Accuracy measures of the results, by kind of job."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import KDTree

from dechirp.evaluation.gospa import gospa
from sides.inputs import unpack_case
from sides.job_types import Inputs
from sides.plain_echoes import direct_sum

Numbers = dict[str, float]


def echoes(x: Inputs, result: np.ndarray) -> Numbers:
    """Compute the relative RMSE of some chirps against the direct sum in double precision.

    Scale and phase of a package are arbitrary, so the best-fit complex scale is removed.
    """
    scatterers, transmission = unpack_case(x)
    n_chirps = len(transmission.starts_s)
    n_evaluated = max(1, min(4, 1000 // len(scatterers.amplitudes)))
    chirps = np.unique(np.linspace(0, n_chirps - 1, n_evaluated).astype(int))
    exact = direct_sum(scatterers, transmission, int(x["n_samples"]), chirps)
    scaled = result[chirps].astype(complex)
    scale = np.vdot(scaled, exact) / np.vdot(scaled, scaled).real
    return {"error": float(np.linalg.norm(scale * scaled - exact) / np.linalg.norm(exact))}


def power_map(x: Inputs, result: np.ndarray) -> Numbers:
    """Compute the RMS over cells of the relative deviation from double precision."""
    samples, n_bins = x["samples"].astype(complex), int(x["n_bins"])
    hann = [0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n) for n in samples.shape]
    spectrum = np.fft.fft(np.fft.fft(samples * np.outer(*hann), axis=0), n_bins, axis=1)
    exact = np.fft.fftshift(abs(spectrum) ** 2, axes=0)
    scaled = result if result.shape == exact.shape else result.T
    scale = np.median(exact / scaled)
    # Cells far below the noise contain only rounding errors.
    is_evaluated = exact > 1e-2 * np.median(exact)
    return {"deviation": float(np.sqrt(np.mean((scale * scaled / exact - 1)[is_evaluated] ** 2)))}


def false_alarms(x: Inputs, result: np.ndarray) -> Numbers:
    """Compute the false-alarm rate over its design value, in the middle and at the edges."""
    rows, columns = (int(t + g) for t, g in zip(x["n_training"], x["n_guard"], strict=True))
    middle = np.zeros(result.shape[1:], bool)
    middle[rows:-rows, columns:-columns] = True
    rates = {}
    for name, where in (("middle", middle), ("edges", ~middle)):
        expected = float(x["false_alarm_probability"]) * where.sum() * len(result)
        rates[f"alarms_{name}"] = float(result[:, where].sum() / expected)
        rates[f"alarms_{name}_std"] = float(expected**-0.5)
    return rates


def frame(x: Inputs, result: np.ndarray) -> Numbers:
    """Count the targets, of three, with an alarm within two cells."""
    steps = np.array([float(x["range_step_m"]), float(x["velocity_step"])])
    if result.dtype == bool:
        velocity, range_bin = np.nonzero(result)
        result = np.column_stack([range_bin, velocity - len(result) // 2]) * steps
    truth = np.column_stack([x["target_range_m"], x["target_velocity"]])
    difference_cells = abs(result[None] - truth[:, None]) / steps
    return {"targets_found": float((difference_cells < 2.5).all(axis=2).any(axis=1).sum())}


def bartlett(x: Inputs, result: np.ndarray) -> Numbers:
    exact = abs(x["snapshots"].astype(complex) @ x["steering"].conj().T) ** 2
    scale = exact.max() / result.max()  # some packages divide by the number of elements
    return {"deviation": float(abs(scale * result - exact).max() / exact.max())}


def directions(x: Inputs, result: np.ndarray) -> Numbers:
    """Compute RMSE / Cramer-Rao bound, of all errors and of the smallest 95 %."""
    error_over_bound = np.sort(abs(result - x["azimuth_rad"]) / x["bound_rad"])
    smallest_errors = error_over_bound[: int(0.95 * len(error_over_bound))]
    return {
        "error_over_bound": float(np.sqrt(np.mean(error_over_bound**2))),
        "of_95_%": float(rms(smallest_errors)),
    }


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def dbscan(x: Inputs, result: np.ndarray) -> Numbers:
    """Compute the adjusted Rand index relative to the true objects of the points.

    If only centres are returned, each point belongs to the cluster with the nearest centre.
    """
    if result.ndim == 2:
        result = KDTree(result).query(x["points"])[1]

    def count_pairs(counts: np.ndarray) -> float:
        return float(np.sum(counts * (counts - 1.0) / 2))

    both = np.unique(np.column_stack([result, x["owner"]]), axis=0, return_counts=True)[1]
    n_estimated_pairs, n_true_pairs = (
        count_pairs(np.unique(labels, return_counts=True)[1]) for labels in (result, x["owner"])
    )
    chance = n_estimated_pairs * n_true_pairs / (len(result) * (len(result) - 1) / 2)
    mean_pairs = (n_estimated_pairs + n_true_pairs) / 2
    return {"agreement": (count_pairs(both) - chance) / (mean_pairs - chance)}


def tracking(x: Inputs, result: np.ndarray) -> Numbers:
    """Compute the mean GOSPA of confirmed tracks from the tenth frame on, with a cut-off of 3 m."""
    errors_m = [
        gospa(tracks[np.isfinite(tracks[:, 0])], truth, cutoff_m=3.0).error_m
        for tracks, truth in zip(result[10:], x["truth_m"][10:], strict=True)
    ]
    return {"gospa_m": float(np.mean(errors_m))}


def decode(x: Inputs, result: np.ndarray) -> Numbers:
    scaled = result.reshape(x["samples"].shape)
    scale = abs(x["samples"]).max() / abs(scaled).max()
    return {"deviation": float(abs(scale * scaled - x["samples"]).max())}


ACCURACY_BY_KIND: dict[str, Callable[[Inputs, np.ndarray], Numbers]] = {
    "echoes": echoes,
    "power_map": power_map,
    "cell_averaging": false_alarms,
    "ordered_statistic": false_alarms,
    "frame": frame,
    "bartlett": bartlett,
    "capon": directions,
    "music": directions,
    "dbscan": dbscan,
    "tracking": tracking,
    "decode": decode,
}
