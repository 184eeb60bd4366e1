"""How right what a side returned is: a few numbers for each kind of job, by name."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import KDTree

from dechirp.evaluation.gospa import gospa
from sides.inputs import case_of
from sides.kinds import Inputs
from sides.plain_echoes import direct_sum

Numbers = dict[str, float]


def echoes(x: Inputs, found: np.ndarray) -> Numbers:
    """Against the sum with `numpy.exp` in double precision, on some of the chirps.

    A package may have a scale and a phase of its own: the best ones are taken out of both.
    """
    scatterers, sent = case_of(x)
    n_chirps = len(sent.starts_s)
    few = max(1, min(4, 1000 // len(scatterers.amplitudes)))
    chirps = np.unique(np.linspace(0, n_chirps - 1, few).astype(int))
    exact = direct_sum(scatterers, sent, int(x["n_samples"]), chirps)
    got = found[chirps].astype(complex)
    scale = np.vdot(got, exact) / np.vdot(got, got).real
    return {"error": float(np.linalg.norm(scale * got - exact) / np.linalg.norm(exact))}


def power_map(x: Inputs, found: np.ndarray) -> Numbers:
    """Root mean square over cells of the relative deviation from double precision."""
    samples, n_bins = x["samples"].astype(complex), int(x["n_bins"])
    hann = [0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n) for n in samples.shape]
    spectrum = np.fft.fft(np.fft.fft(samples * np.outer(*hann), axis=0), n_bins, axis=1)
    exact = np.fft.fftshift(abs(spectrum) ** 2, axes=0)
    got = found if found.shape == exact.shape else found.T
    scale = np.median(exact / got)
    # Cells far below the noise are rounding alone.
    counts = exact > 1e-2 * np.median(exact)
    return {"deviation": float(np.sqrt(np.mean((scale * got / exact - 1)[counts] ** 2)))}


def false_alarms(x: Inputs, found: np.ndarray) -> Numbers:
    """Rate over design: where the whole window fits, and at the edges, with standard errors."""
    rows, columns = (int(t + g) for t, g in zip(x["n_training"], x["n_guard"], strict=True))
    middle = np.zeros(found.shape[1:], bool)
    middle[rows:-rows, columns:-columns] = True
    told = {}
    for name, where in (("middle", middle), ("edges", ~middle)):
        expected = float(x["false_alarm_probability"]) * where.sum() * len(found)
        told[f"alarms_{name}"] = float(found[:, where].sum() / expected)
        told[f"alarms_{name}_std"] = float(expected**-0.5)
    return told


def frame(x: Inputs, found: np.ndarray) -> Numbers:
    """Of three targets those with an alarm within two cells."""
    steps = np.array([float(x["range_step_m"]), float(x["velocity_step"])])
    if found.dtype == bool:
        velocity, range_bin = np.nonzero(found)
        found = np.column_stack([range_bin, velocity - len(found) // 2]) * steps
    at = np.column_stack([x["target_range_m"], x["target_velocity"]])
    off = abs(found[None] - at[:, None]) / steps
    return {"targets_found": float((off < 2.5).all(axis=2).any(axis=1).sum())}


def bartlett(x: Inputs, found: np.ndarray) -> Numbers:
    exact = abs(x["snapshots"].astype(complex) @ x["towards"].conj().T) ** 2
    scale = exact.max() / found.max()  # some divide by the number of elements
    return {"deviation": float(abs(scale * found - exact).max() / exact.max())}


def directions(x: Inputs, found: np.ndarray) -> Numbers:
    """Root mean square error over the Cramer-Rao bound, and of the middle nine tenths."""
    over = np.sort(abs(found - x["azimuth_rad"]) / x["bound_rad"])
    kept = over[: int(0.95 * len(over))]
    return {"error_over_bound": float(np.sqrt(np.mean(over**2))), "of_95_%": float(rms(kept))}


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def dbscan(x: Inputs, found: np.ndarray) -> Numbers:
    """Rand index, adjusted for chance, beside the objects that the points are of.

    Where centres are told alone, a point is in the cluster whose centre is nearest.
    """
    if found.ndim == 2:
        found = KDTree(found).query(x["places"])[1]

    def pairs(counts: np.ndarray) -> float:
        return float(np.sum(counts * (counts - 1.0) / 2))

    both = np.unique(np.column_stack([found, x["owner"]]), axis=0, return_counts=True)[1]
    ours, theirs = (pairs(np.unique(one, return_counts=True)[1]) for one in (found, x["owner"]))
    chance = ours * theirs / (len(found) * (len(found) - 1) / 2)
    return {"agreement": (pairs(both) - chance) / ((ours + theirs) / 2 - chance)}


def tracking(x: Inputs, found: np.ndarray) -> Numbers:
    """Mean GOSPA of confirmed tracks from the tenth frame on, cut off at 3 m."""
    apart = [
        gospa(now[np.isfinite(now[:, 0])], true, cutoff_m=3.0).error_m
        for now, true in zip(found[10:], x["truth_m"][10:], strict=True)
    ]
    return {"gospa_m": float(np.mean(apart))}


def decode(x: Inputs, found: np.ndarray) -> Numbers:
    got = found.reshape(x["samples"].shape)
    scale = abs(x["samples"]).max() / abs(got).max()
    return {"deviation": float(abs(scale * got - x["samples"]).max())}


OF_KIND: dict[str, Callable[[Inputs, np.ndarray], Numbers]] = {
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
