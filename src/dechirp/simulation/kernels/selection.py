"""Kernel selection: the cheapest applicable kernel for each run of chirps, by a cost model.

The model counts samples, lines and scatterers, and multiplies them by times measured on one core
with 512-bit vectors (AMD EPYC, 2026). It is up to nine times too low if scatterers pass through
many
range cells in a frame, but equally for all kernels: for 24 tried sizes, the chosen kernel took at
most twice as long as the best. Near and fast scatterers, which the direct kernel sums in short
segments and the low-rank kernel passes on to it, are estimated from a sample.
"""

from typing import Literal, NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import (
    can_compile,
    compiled_kernels_for_large_work,
    uses_compiled_kernels,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.threads import run_in_threads, split_range, thread_count
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.simulation.engine import MIN_TOLERANCE, Engine
from dechirp.simulation.kernels import direct
from dechirp.simulation.kernels.base import Scatterers, Transmission

Kernel = Literal["direct", "low-rank", "nufft"]
"""Name of a kernel."""


class KernelCosts(NamedTuple):
    """Predicted time of each kernel on one thread, s; infinite if it is not applicable."""

    direct: float
    low_rank: float
    nufft: float

    def predicted_time_s(self, kernel: Kernel) -> float:
        """Return the predicted time of one kernel, s."""
        return float(getattr(self, kernel.replace("-", "_")))

    @property
    def cheapest_kernel(self) -> Kernel:
        """Return the kernel with the least predicted time."""
        names: tuple[Kernel, ...] = ("direct", "low-rank", "nufft")
        return min(names, key=self.predicted_time_s)


def predict_kernel_times(
    cube_shape: tuple[int, ...],
    scatterers: Scatterers,
    transmission: Transmission,
    tolerance: float,
) -> KernelCosts:
    """Predict the time of each kernel for a cube of (n_chirps, n_rx, n_samples)."""
    _, n_rx, n_samples = cube_shape
    n = len(scatterers.amplitudes)
    n_lines = int(np.count_nonzero(transmission.weights)) * n_rx
    n_pairs = int(np.count_nonzero(transmission.weights.any(axis=0))) * n_rx
    not_applicable = float("inf")
    is_compiled = uses_compiled_kernels()
    extra_segments = (
        direct.estimate_segments_per_chirp(scatterers, transmission, n_samples) - 1
        if is_compiled
        else 0.0
    )
    scatterer_s = n_samples * 0.29e-9 + 170e-9 + 300e-9 * extra_segments
    predicted = KernelCosts(
        direct=n_lines * (n_samples * 0.5e-9 + n * scatterer_s),
        low_rank=n_lines * (n_samples * 0.25e-9 + n * (n_samples * 0.16e-9 + 35e-9))
        if tolerance >= MIN_TOLERANCE["low-rank"]
        else not_applicable,
        nufft=n_pairs * (1e-3 + n * 200e-9) + n_lines * n_samples * 10e-9
        if tolerance >= MIN_TOLERANCE["nufft"] and scatterers.chirp_factors is None
        else not_applicable,
    )
    if predicted.cheapest_kernel != "low-rank" or not is_compiled:
        return predicted
    from dechirp.simulation.kernels import low_rank

    share = low_rank.estimate_fraction_cheaper_direct(
        scatterers, transmission, n_samples, tolerance=tolerance
    )
    return predicted._replace(low_rank=predicted.low_rank + n_lines * share * n * scatterer_s)


def choose_kernel_and_predict_times(
    cube_shape: tuple[int, ...],
    scatterers: Scatterers,
    transmission: Transmission,
    engine: Engine,
    dtype: np.dtype,
) -> tuple[Kernel, KernelCosts]:
    """Return the kernel of the engine for a cube of this shape, and the predicted times of all.

    Raises
    ------
    InvalidSetting
        If the engine specifies a kernel that is not applicable.
    """
    predicted = predict_kernel_times(
        cube_shape, scatterers, transmission, engine.effective_tolerance(dtype)
    )
    if engine.kernel == "auto":  # the direct kernel alone has a plain twin
        return predicted.cheapest_kernel if uses_compiled_kernels() else "direct", predicted
    if np.isinf(predicted.predicted_time_s(engine.kernel)):
        raise InvalidSetting(
            "Engine.kernel",
            value=f"{engine.kernel}, with targets that fluctuate from chirp to chirp",
            expected="the low-rank or the direct kernel, which allow for that",
            fix="choose low-rank, direct or auto",
        )
    # The plain twin of each kernel: all agree within the tolerance of the engine.
    return engine.kernel if can_compile() else "direct", predicted


def add_echoes(
    out: np.ndarray,
    scatterers: Scatterers,
    transmission: Transmission,
    *,
    engine: Engine,
    previous: direct.PreviousRamps | None = None,
) -> set[str]:
    """Add echoes to `out`, (n_chirps, n_rx, n_samples) complex; return the kernels' names.

    The direct kernel sums scatterers whose echoes arrive late, if the engine treats these
    specially.

    Raises
    ------
    InvalidSetting
        If a number is not finite, or the chosen kernel is not applicable.
    """
    _check_inputs_finite(scatterers, transmission)
    used: set[str] = set()
    if engine.late != "held":
        late = _mask_of_late_scatterers(scatterers, transmission)
        if late.any():
            used.add("direct")
            _add_by_direct_kernel(out, scatterers.select(late), transmission, engine.late, previous)
        scatterers = scatterers.select(~late)
    if not len(scatterers.amplitudes):
        return used
    n_products = out.size * len(scatterers.amplitudes) * len(transmission.tx_m)
    with compiled_kernels_for_large_work(n_products):
        return used | _add_by_suitable_kernel(out, scatterers, transmission, engine)


def _add_by_suitable_kernel(
    out: np.ndarray, scatterers: Scatterers, transmission: Transmission, engine: Engine
) -> set[str]:
    """Add echoes by the kernel of the engine; return its name."""
    tolerance = engine.effective_tolerance(out.dtype)
    kernel, predicted = choose_kernel_and_predict_times(
        out.shape, scatterers, transmission, engine, out.dtype
    )
    n_threads = _thread_count_for_duration(predicted.predicted_time_s(kernel))
    if kernel == "direct":
        _add_by_direct_kernel(out, scatterers, transmission, "held", None)
    elif kernel == "low-rank":
        from dechirp.simulation.kernels import low_rank

        def sum_rows(rows: slice) -> None:
            low_rank.add_echoes(
                out[rows], *select_chirps(scatterers, transmission, rows), tolerance=tolerance
            )

        run_in_threads(n_threads, sum_rows, split_range(len(out), n_threads))
    else:
        from dechirp.simulation.kernels import nufft

        nufft.add_echoes(out, scatterers, transmission, tolerance=tolerance, n_threads=n_threads)
    return {kernel}


def select_chirps(
    scatterers: Scatterers, transmission: Transmission, chirps: slice
) -> tuple[Scatterers, Transmission]:
    """Return scatterers and transmission of some of the chirps."""
    factors = scatterers.chirp_factors
    if factors is not None:
        scatterers = scatterers._replace(chirp_factors=factors[chirps])
    return scatterers, transmission._replace(
        starts_s=transmission.starts_s[chirps], weights=transmission.weights[chirps]
    )


def _add_by_direct_kernel(
    out: np.ndarray,
    scatterers: Scatterers,
    transmission: Transmission,
    late: Literal["held", "onset", "tail"],
    previous: direct.PreviousRamps | None,
) -> None:
    predicted_s = predict_kernel_times(
        out.shape, scatterers, transmission, MIN_TOLERANCE["direct"]
    ).direct

    def sum_rows(rows: slice) -> None:
        row_previous = None if previous is None else previous.select_chirps(rows)
        direct.add_echoes(
            out[rows],
            *select_chirps(scatterers, transmission, rows),
            late=late,
            previous=row_previous,
        )

    n_threads = _thread_count_for_duration(predicted_s)
    run_in_threads(n_threads, sum_rows, split_range(len(out), n_threads))


def _thread_count_for_duration(predicted_s: float) -> int:
    """Return one thread for short work, since another takes 0.05 ms to start."""
    return thread_count() if predicted_s > 0.3e-3 else 1


def _mask_of_late_scatterers(scatterers: Scatterers, transmission: Transmission) -> np.ndarray:
    """Return a mask of scatterers whose echo may arrive after the first sample of some chirp."""
    times_s = (
        np.array([transmission.starts_s[0], transmission.starts_s[-1]]) + transmission.adc_start_s
    )
    reach_s = np.abs(times_s).max()
    farthest_m = np.linalg.norm(scatterers.path_m[0], axis=-1)
    for k in range(1, len(scatterers.path_m)):
        farthest_m += np.linalg.norm(scatterers.path_m[k], axis=-1) * reach_s**k
    antennas_m = max(
        np.linalg.norm(antennas, axis=-1).max()
        for antennas in (transmission.tx_m, transmission.rx_m)
    )
    return np.asarray(2 * (farthest_m + antennas_m) > SPEED_OF_LIGHT * transmission.adc_start_s)


def _check_inputs_finite(scatterers: Scatterers, transmission: Transmission) -> None:
    for name, array in (*scatterers._asdict().items(), *transmission._asdict().items()):
        if array is not None and not np.isfinite(array).all():
            raise InvalidSetting(
                f"echoes.{name}",
                value="a number that is not finite",
                expected="finite paths, amplitudes, gains and antenna positions",
                fix="check the bodies and patterns for values that are not finite",
            )
