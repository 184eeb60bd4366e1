"""Tone expansion: echoes of one antenna pair in a run of chirps, as tones with series."""

from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.core.threads import run_in_threads, split_range
from dechirp.simulation.kernels.base import Transmission
from dechirp.simulation.kernels.chebyshev import economised_monomials_and_rms_errors
from dechirp.simulation.kernels.taylor import (
    BLOCK,
    DOPPLER,
    IMAG,
    LANES,
    ORDER,
    RANGE,
    REAL,
    SERIES,
    WORK,
    AntennaPairView,
    fill_tone_block,
    fill_tone_blocks,
    polynomial_time_shift_matrix,
)

_compiled = kernel(fastmath={"contract", "reassoc"})

MAX_FIELDS = 6
"""Largest number of fields of a series; scatterers that need more are summed in another way."""

_STEPS = 128  # of errors, down to 2^-64 of the allowed error


class ScattererPaths(NamedTuple):
    """Scatterers in a memory layout for vectors."""

    path_m: np.ndarray
    """(n_terms, 3, n)."""
    amplitudes: np.ndarray
    tx_gains: np.ndarray
    rx_gains: np.ndarray

    def select(self, selected: np.ndarray | slice) -> "ScattererPaths":
        """Return the selected scatterers."""
        return ScattererPaths(*(np.ascontiguousarray(array[..., selected]) for array in self))

    def with_rms_gains(self, transmitters: list[int], receivers: list[int]) -> "ScattererPaths":
        """Return the paths with all gains replaced by the root mean square over some antennas."""
        tx, rx = self.tx_gains, self.rx_gains
        return self._replace(
            tx_gains=np.broadcast_to(np.sqrt(np.mean(tx[transmitters] ** 2, axis=0)), tx.shape),
            rx_gains=np.broadcast_to(np.sqrt(np.mean(rx[receivers] ** 2, axis=0)), rx.shape),
        )


class Waveform(NamedTuple):
    """Run of chirps relative to the middle of each sampling window."""

    mid_frequency_hz: float
    """Frequency at the sample in the middle of the window."""
    slope_hz_per_s: float
    sample_rate_hz: float
    n_samples: int
    times_s: np.ndarray
    """(n_chirps,): middles of the windows, in the time of the paths."""

    @property
    def half_window_s(self) -> float:
        """Return the time from the first sample to the middle of a window; at least one step."""
        return max(self.n_samples // 2, 1) / self.sample_rate_hz


def antenna_pair_view(
    paths: ScattererPaths,
    transmission: Transmission,
    waveform: Waveform,
    pair: tuple[int, int],
    mid_s: float,
    half_s: float,
    *,
    one_chirp: bool,
) -> AntennaPairView:
    """Return the view of a transmitter and a receiver about `mid_s`, `half_s` to both sides."""
    tx, rx = pair
    return AntennaPairView(
        paths.path_m,
        paths.amplitudes * paths.tx_gains[tx] * paths.rx_gains[rx],
        np.ascontiguousarray(transmission.tx_m[tx], float),
        np.ascontiguousarray(transmission.rx_m[rx], float),
        float(mid_s),
        float(half_s),
        float(waveform.mid_frequency_hz),
        float(waveform.slope_hz_per_s),
        one_chirp,
    )


def expand_tones(view: AntennaPairView) -> np.ndarray:
    """Return blocks of tones as defined in `taylor`, (n_blocks, BLOCK)."""
    blocks = np.empty((-(-len(view.amplitudes) // LANES), BLOCK))
    fill_tone_blocks(view, blocks)
    return blocks


class ToneSurvey(NamedTuple):
    """Statistics of the tones of many scatterers."""

    low_hz: float
    """Lowest beat frequency."""
    high_hz: float
    max_doppler_hz: float
    """Largest magnitude of the Doppler frequency."""
    power: float
    """Sum of the squares of the amplitudes."""
    errors: np.ndarray
    """(n,): bound on the power of each truncated series."""


def survey_tone_frequencies_and_errors(
    view: AntennaPairView, n_fields: int, n_threads: int = 1
) -> ToneSurvey:
    """Survey all tones, for series of `n_fields` fields."""
    errors = np.empty(len(view.amplitudes))
    parts = split_range(-(-len(errors) // LANES), n_threads)
    statistics = np.empty((len(parts), 4))
    remainders = ECONOMISATIONS[n_fields - 1][1]

    def survey_part(part: int) -> None:
        _survey_tone_blocks(
            view, remainders, parts[part].start, parts[part].stop, statistics[part], errors
        )

    run_in_threads(n_threads, survey_part, range(len(parts)))
    low_hz, high_hz, fastest_hz = (
        statistics[:, 0].min(),
        statistics[:, 1].max(),
        statistics[:, 2].max(),
    )
    return ToneSurvey(
        float(low_hz), float(high_hz), float(fastest_hz), statistics[:, 3].sum(), errors
    )


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _survey_tone_blocks(
    view: AntennaPairView,
    truncation_remainders: np.ndarray,
    first_block: int,
    stop_block: int,
    statistics: np.ndarray,
    errors: np.ndarray,
) -> None:
    work, block, line = np.zeros(WORK), np.empty(BLOCK), np.empty(LANES)
    shifts = polynomial_time_shift_matrix(view)
    low_hz, high_hz, fastest_hz, power = np.inf, -np.inf, 0.0, 0.0
    for b in range(first_block, stop_block):
        fill_tone_block(view, shifts, b * LANES, work, block)
        _fill_block_truncation_error_powers(block, truncation_remainders, line)
        for i in range(LANES):
            low_hz, high_hz = min(low_hz, block[RANGE + i]), max(high_hz, block[RANGE + i])
            fastest_hz = max(fastest_hz, abs(block[DOPPLER + i]))
            power += block[REAL + i] ** 2 + block[IMAG + i] ** 2
        for i in range(min(LANES, len(errors) - b * LANES)):
            errors[b * LANES + i] = line[i]
    statistics[0], statistics[1], statistics[2], statistics[3] = low_hz, high_hz, fastest_hz, power


ECONOMISATIONS = tuple(
    economised_monomials_and_rms_errors(n_fields, ORDER) for n_fields in range(1, MAX_FIELDS + 1)
)
"""Results of `economised_monomials_and_rms_errors` for each number of fields, from 1 on."""


def truncation_error_powers(
    blocks: np.ndarray, n_fields: int, relative_duration: float = 1.0
) -> np.ndarray:
    """Return a bound on the truncation error of `n_fields` fields, as power, (n_blocks x LANES,).

    `relative_duration` is the length of a run over that of the blocks, about the same middle.
    """
    errors = np.empty((len(blocks), LANES))
    _fill_truncation_error_powers(
        blocks, ECONOMISATIONS[n_fields - 1][1] * relative_duration ** np.arange(ORDER), errors
    )
    return errors.ravel()


def tone_powers(blocks: np.ndarray) -> np.ndarray:
    """Return the power of each scatterer, (n_blocks, LANES)."""
    real, imag = blocks[:, REAL : REAL + LANES], blocks[:, IMAG : IMAG + LANES]
    return np.asarray(real * real + imag * imag)


def mask_scatterers_with_largest_errors(errors: np.ndarray, allowed_sum: float) -> np.ndarray:
    """Return a mask of the few scatterers to remove, so that the errors meet `allowed_sum`."""
    return np.asarray(~(errors <= _largest_error_to_keep(errors, allowed_sum)))


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _largest_error_to_keep(errors: np.ndarray, allowed_sum: float) -> float:
    """Return the limit up to which errors add up to at most `allowed_sum`, in steps of 1.4."""
    # Errors above `allowed` are excluded, infinite ones too.
    total = 0.0
    for i in range(len(errors)):
        if errors[i] <= allowed_sum:
            total += errors[i]
    if total <= allowed_sum:
        return allowed_sum
    sums = np.zeros(_STEPS)
    for i in range(len(errors)):
        if errors[i] <= allowed_sum:
            below = -2 * np.log2(max(errors[i] / allowed_sum, 1e-38))
            sums[min(int(below), _STEPS - 1)] += errors[i]
    step = 0
    while step < _STEPS and total > allowed_sum:
        total -= sums[step]
        step += 1
    return allowed_sum * 2 ** (-step / 2)


@_compiled
def _fill_block_truncation_error_powers(
    block: np.ndarray, truncation_remainders: np.ndarray, errors: np.ndarray
) -> None:
    for i in range(LANES):
        errors[i] = 0.0
    for k in range(1, ORDER):
        share = truncation_remainders[k]
        if share != 0:
            real = np.uint64(SERIES + 2 * LANES * (k - 1))
            imag = real + np.uint64(LANES)
            for i in range(np.uint64(LANES)):
                g, h = block[real + i], block[imag + i]
                errors[i] += share * np.sqrt(g * g + h * h)
    for i in range(LANES):
        errors[i] *= errors[i] * (block[REAL + i] ** 2 + block[IMAG + i] ** 2)


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _fill_truncation_error_powers(
    blocks: np.ndarray, truncation_remainders: np.ndarray, errors: np.ndarray
) -> None:
    for b in range(len(blocks)):
        _fill_block_truncation_error_powers(blocks[b], truncation_remainders, errors[b])
