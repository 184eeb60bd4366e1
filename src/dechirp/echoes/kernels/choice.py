"""Which kernel sums a run of chirps: the cheapest that may, by a model of their costs.

The model counts samples, lines and scatterers and multiplies them by what each took on one
core with 512-bit vectors (AMD EPYC, 2026). It is rough where scatterers pass through many range
cells in a frame, up to nine times too low, and there for all kernels alike: of 24 sizes tried,
the one chosen took at most twice as long as the best. Near and fast ones, which the direct kernel
sums in short segments and the product leaves to it, are counted from some of them.
"""

from typing import Literal, NamedTuple

import numba
import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.threads import in_threads, slices
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.echoes.engine import FINEST, Engine
from dechirp.echoes.kernels import direct, nonuniform, product
from dechirp.echoes.kernels.base import Scatterers, Sent

Kernel = Literal["direct", "product", "nonuniform"]


class Costs(NamedTuple):
    """Predicted time of each kernel on one thread, s; infinite where it cannot."""

    direct: float
    product: float
    nonuniform: float

    @property
    def cheapest(self) -> Kernel:
        """The one that takes least."""
        names: tuple[Kernel, ...] = ("direct", "product", "nonuniform")
        return min(names, key=lambda name: getattr(self, name))


def costs(shape: tuple[int, ...], scatterers: Scatterers, sent: Sent, tolerance: float) -> Costs:
    """Predict what each kernel takes for a cube of (n_chirps, n_rx, n_samples)."""
    _, n_rx, n_samples = shape
    n = len(scatterers.amplitudes)
    n_lines = int(np.count_nonzero(sent.weights)) * n_rx
    n_pairs = int(np.count_nonzero(sent.weights.any(axis=0))) * n_rx
    cannot = float("inf")
    more = direct.segments(scatterers, sent, n_samples) - 1
    one_s = n_samples * 0.29e-9 + 170e-9 + 300e-9 * more
    found = Costs(
        direct=n_lines * (n_samples * 0.5e-9 + n * one_s),
        product=n_lines * (n_samples * 0.25e-9 + n * (n_samples * 0.16e-9 + 35e-9))
        if tolerance >= FINEST["product"]
        else cannot,
        nonuniform=n_pairs * (1e-3 + n * 200e-9) + n_lines * n_samples * 10e-9
        if tolerance >= FINEST["nonuniform"] and scatterers.chirp_factors is None
        else cannot,
    )
    if found.cheapest != "product":
        return found
    share = product.handed_over(scatterers, sent, n_samples, tolerance=tolerance)
    return found._replace(product=found.product + n_lines * share * n * one_s)


def chosen(
    shape: tuple[int, ...],
    scatterers: Scatterers,
    sent: Sent,
    engine: Engine,
    dtype: np.dtype,
) -> tuple[Kernel, Costs]:
    """The kernel that the engine takes for a cube of this shape, and the costs of each.

    Raises
    ------
    InvalidSetting
        If the engine names a kernel that cannot do it.
    """
    predicted = costs(shape, scatterers, sent, engine.tolerance_of(dtype))
    if engine.kernel == "auto":
        return predicted.cheapest, predicted
    if np.isinf(getattr(predicted, engine.kernel)):
        raise InvalidSetting(
            "Engine.kernel",
            got=f"{engine.kernel}, with targets that fluctuate from chirp to chirp",
            need="another kernel: this one sums whole runs of chirps",
            fix="Take the product or the direct kernel, or auto.",
        )
    return engine.kernel, predicted


def add(
    out: np.ndarray,
    scatterers: Scatterers,
    sent: Sent,
    *,
    engine: Engine,
    before: direct.Before | None = None,
) -> set[str]:
    """Sum echoes into `out`, (n_chirps, n_rx, n_samples) complex; return the kernels' names.

    Scatterers whose echoes begin late, where that counts, are left to the direct kernel.

    Raises
    ------
    InvalidSetting
        If a number is not finite, or the kernel that was chosen cannot do it.
    """
    _must_be_finite(scatterers, sent)
    tolerance = engine.tolerance_of(out.dtype)
    used: set[str] = set()
    if engine.late != "held":
        late = _arrives_late(scatterers, sent)
        if late.any():
            used.add("direct")
            _add_direct(out, some(scatterers, late), sent, engine.late, before)
        scatterers = some(scatterers, ~late)
    if not len(scatterers.amplitudes):
        return used
    kernel, predicted = chosen(out.shape, scatterers, sent, engine, out.dtype)
    n_threads = _n_threads(getattr(predicted, kernel))
    if kernel == "direct":
        _add_direct(out, scatterers, sent, "held", None)
    elif kernel == "product":

        def one(rows: slice) -> None:
            product.add(out[rows], *rows_of(scatterers, sent, rows), tolerance=tolerance)

        in_threads(n_threads, one, slices(len(out), n_threads))
    else:
        nonuniform.add(out, scatterers, sent, tolerance=tolerance, n_threads=n_threads)
    return used | {kernel}


def some(scatterers: Scatterers, chosen: np.ndarray | slice) -> Scatterers:
    """Those scatterers that are chosen."""
    factors = scatterers.chirp_factors
    return Scatterers(
        scatterers.path_m[:, chosen],
        scatterers.amplitudes[chosen],
        scatterers.tx_gains[:, chosen],
        scatterers.rx_gains[:, chosen],
        None if factors is None else factors[:, chosen],
    )


def rows_of(scatterers: Scatterers, sent: Sent, rows: slice) -> tuple[Scatterers, Sent]:
    """What is needed for some of the chirps."""
    factors = scatterers.chirp_factors
    if factors is not None:
        scatterers = scatterers._replace(chirp_factors=factors[rows])
    return scatterers, sent._replace(starts_s=sent.starts_s[rows], weights=sent.weights[rows])


def _add_direct(
    out: np.ndarray,
    scatterers: Scatterers,
    sent: Sent,
    late: Literal["held", "onset", "tail"],
    before: direct.Before | None,
) -> None:
    took_s = costs(out.shape, scatterers, sent, FINEST["direct"]).direct

    def one(rows: slice) -> None:
        own = None if before is None else before.of(rows)
        direct.add(out[rows], *rows_of(scatterers, sent, rows), late=late, before=own)

    n_threads = _n_threads(took_s)
    in_threads(n_threads, one, slices(len(out), n_threads))


def _n_threads(predicted_s: float) -> int:
    """One thread for short work: another takes 0.05 ms to start."""
    return numba.get_num_threads() if predicted_s > 0.3e-3 else 1


def _arrives_late(scatterers: Scatterers, sent: Sent) -> np.ndarray:
    """Which scatterers' echoes may come after the first sample of some chirp."""
    times_s = np.array([sent.starts_s[0], sent.starts_s[-1]]) + sent.adc_start_s
    reach_s = np.abs(times_s).max()
    farthest_m = np.linalg.norm(scatterers.path_m[0], axis=-1)
    for k in range(1, len(scatterers.path_m)):
        farthest_m += np.linalg.norm(scatterers.path_m[k], axis=-1) * reach_s**k
    antennas_m = max(np.linalg.norm(at, axis=-1).max() for at in (sent.tx_m, sent.rx_m))
    return np.asarray(2 * (farthest_m + antennas_m) > SPEED_OF_LIGHT * sent.adc_start_s)


def _must_be_finite(scatterers: Scatterers, sent: Sent) -> None:
    for name, array in (*scatterers._asdict().items(), *sent._asdict().items()):
        if array is not None and not np.isfinite(array).all():
            raise InvalidSetting(
                f"echoes.{name}",
                got="a number that is not finite",
                need="finite paths, amplitudes, gains and antennas",
                fix="Look for a body or a pattern that gives no number somewhere.",
            )
