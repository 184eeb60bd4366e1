"""Background of a frame: static echoes from its quieter chirps, and a predictor of moving ones.

Static echoes are equal in every chirp and are subtracted. Moving echoes are smooth over fast
time: a linear predictor, fitted to the quieter half of the chirps, removes them from every sample
by those before, and leaves white noise.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dechirp.core.compiled_kernels import kernel

MIN_CHIRPS = 4  # of one transmitter; fewer do not determine static echoes
MIN_SAMPLES = 16
_N_GROUPS = 16  # the median of group means gives static echoes; bursts in 7 groups do not affect it
_N_FITTED_SAMPLES = 2**14  # samples for the fit of the predictor: 1000 for each weight
_MIN_POWER = 1e-36  # of full power; the inverse of less overflows float32
ROUNDING_POWER = 1e-12
"""-120 dB; float32 has -144 dB, a 16-bit converter -98 dB."""


@dataclass(frozen=True)
class Background:
    """Background of a frame from the quieter half of its chirps, relative to a scale."""

    quiet_chirps: np.ndarray
    """Chirps with the weakest moving echoes, (n,), ascending."""
    static_samples: np.ndarray
    """Static echoes (slot, rx, value): two values for each complex sample."""
    receiver_weight: np.ndarray
    """Inverse power of moving echoes, (rx,); 0 for receivers without any."""
    rounding_power: float
    """Power of rounding errors, with the same weights."""
    predictor: np.ndarray
    """Weights of the samples before, (order,), that predict moving echoes, the nearest first;
    empty without moving echoes."""


def estimate_background(
    samples: np.ndarray, is_lost: np.ndarray, *, n_slots: int, largest_value: float
) -> Background | None:
    """Estimate the background from the quieter half of a frame; None for few chirps or samples.

    Parameters
    ----------
    samples : array (chirp, rx, sample), complex64 or float32, contiguous
    is_lost : array (chirp,), bool
        Chirps to leave out.
    n_slots : int
        Number of chirps after which the same transmitter sends again.
    largest_value : float
        Largest value.
    """
    n_rx, n_samples = samples.shape[1:]
    n_kept = min(int(np.count_nonzero(~is_lost[slot::n_slots])) for slot in range(n_slots))
    if n_kept < MIN_CHIRPS or n_samples < MIN_SAMPLES:
        return None
    numbers, inverse = samples.view(np.float32), np.float32(1 / largest_value)
    usable = np.flatnonzero(~is_lost)
    static_samples = estimate_static_samples(numbers, usable, n_slots, inverse)
    power, _ = _moving_and_total_power(numbers, static_samples, inverse)
    quiet_chirps = _quieter_half_of_chirps(power.sum(axis=1), usable, n_slots)
    # The median selected the chirps; their mean is smoother than the median.
    static_samples = estimate_static_samples(numbers, quiet_chirps, n_slots, inverse, groups=1)
    power, mean_power = _moving_and_total_power(numbers, static_samples, inverse)
    total_power = mean_power[~is_lost].mean(axis=0)
    weight = np.zeros(n_rx, np.float32)
    typical_power = np.median(power[quiet_chirps], axis=0)
    is_alive = typical_power > np.maximum(ROUNDING_POWER * total_power, _MIN_POWER)
    weight[is_alive] = 1 / typical_power[is_alive]
    predictor = np.zeros(0)
    if is_alive.any():
        receivers = np.flatnonzero(is_alive)
        predictor = _fit_linear_predictor(
            samples, static_samples.view(samples.dtype), quiet_chirps, receivers, inverse
        )
    rounding_power = ROUNDING_POWER * float(np.sum(weight * total_power))
    return Background(
        quiet_chirps=quiet_chirps,
        static_samples=static_samples,
        receiver_weight=weight,
        rounding_power=rounding_power,
        predictor=predictor,
    )


def estimate_static_samples(
    numbers: np.ndarray,
    chirps: np.ndarray,
    n_slots: int,
    inverse_scale: np.float32,
    *,
    groups: int = _N_GROUPS,
) -> np.ndarray:
    """Return static echoes, (slot, rx, value): the median of the means of groups of chirps.

    A mean of all would carry a burst of 60 dB in one of 128 chirps into the others, 18 dB over
    the noise.
    """
    out = np.zeros((n_slots, *numbers.shape[1:]), np.float32)
    for slot in range(n_slots):
        slot_chirps = chirps[chirps % n_slots == slot] if n_slots > 1 else chirps
        n_groups = max(1, min(groups, slot_chirps.size))
        size, n_larger = divmod(slot_chirps.size, n_groups)
        index = np.arange(n_groups + 1)
        _write_median_of_group_means(
            numbers,
            slot_chirps,
            size * index + np.minimum(index, n_larger),
            inverse_scale,
            out[slot],
        )
    return out


def _write_median_of_group_means_in_numpy(
    numbers: np.ndarray,
    chirps: np.ndarray,
    starts: np.ndarray,
    inverse_scale: np.float32,
    out: np.ndarray,
) -> None:
    if not chirps.size:
        return
    sums = np.add.reduceat(numbers[chirps], starts[:-1], axis=0)
    sizes = np.diff(starts).astype(np.float32)[:, None, None]
    means = sums * (inverse_scale / sizes)
    below, above = (len(means) - 1) // 2, len(means) // 2
    means.partition([below, above], axis=0)
    np.multiply(means[below] + means[above], np.float32(0.5), out=out)


@kernel(plain=_write_median_of_group_means_in_numpy, fastmath={"contract", "reassoc"})
def _write_median_of_group_means(
    numbers: np.ndarray,
    chirps: np.ndarray,
    starts: np.ndarray,
    inverse_scale: np.float32,
    out: np.ndarray,
) -> None:
    """Write the median over groups of chirps of their means to (rx, value); zeros of none."""
    n_groups, (n_rx, n_values) = starts.size - 1, out.shape
    if not chirps.size:
        return
    means = np.zeros((n_groups, n_values), np.float32)
    cell = np.empty(n_groups, np.float32)
    for k in range(n_rx):
        means[:] = 0
        for group in range(n_groups):
            share = inverse_scale / np.float32(starts[group + 1] - starts[group])
            row = means[group]
            for i in range(starts[group], starts[group + 1]):
                values = numbers[chirps[i], k]
                for j in range(n_values):
                    row[j] += share * values[j]
        if n_groups == 1:
            out[k] = means[0]
            continue
        for j in range(n_values):
            for group in range(n_groups):  # insertion sort of at most 16 values
                value, i = means[group, j], group
                while i > 0 and cell[i - 1] > value:
                    cell[i] = cell[i - 1]
                    i -= 1
                cell[i] = value
            middle = n_groups // 2
            out[k, j] = (
                cell[middle]
                if n_groups % 2
                else np.float32(0.5) * (cell[middle - 1] + cell[middle])
            )


def _moving_and_total_power_in_numpy(
    numbers: np.ndarray, static_samples: np.ndarray, inverse_scale: np.float32
) -> tuple[np.ndarray, np.ndarray]:
    scaled = numbers * inverse_scale
    moving = scaled - static_samples[np.arange(len(numbers)) % len(static_samples)]
    powers = [np.einsum("mki,mki->mk", x, x) for x in (moving, scaled)]
    return powers[0] / numbers.shape[2], powers[1] / numbers.shape[2]


@kernel(plain=_moving_and_total_power_in_numpy, fastmath={"contract", "reassoc"})
def _moving_and_total_power(
    numbers: np.ndarray, static_samples: np.ndarray, inverse_scale: np.float32
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean squares of the moving part, and of all, (chirp, rx)."""
    n_chirps, n_rx, n_numbers = numbers.shape
    moving = np.zeros((n_chirps, n_rx), np.float64)
    total = np.zeros((n_chirps, n_rx), np.float64)
    for m in range(n_chirps):
        for k in range(n_rx):
            moving_sum, total_sum = np.float32(0), np.float32(0)
            for i in range(n_numbers):
                x = numbers[m, k, i] * inverse_scale
                y = x - static_samples[m % static_samples.shape[0], k, i]
                total_sum += x * x
                moving_sum += y * y
            moving[m, k], total[m, k] = moving_sum / n_numbers, total_sum / n_numbers
    return moving, total


def _quieter_half_of_chirps(power: np.ndarray, usable: np.ndarray, n_slots: int) -> np.ndarray:
    """Return the chirps with the least moving power, half of each transmitter, ascending."""
    quiet_chirps = []
    for slot in range(n_slots):
        slot_chirps = usable[usable % n_slots == slot]
        quiet_chirps.append(
            slot_chirps[np.argsort(power[slot_chirps])[: (slot_chirps.size + 1) // 2]]
        )
    return np.sort(np.concatenate(quiet_chirps))


def _fit_linear_predictor(
    samples: np.ndarray,
    static_samples: np.ndarray,
    quiet_chirps: np.ndarray,
    receivers: np.ndarray,
    inverse_scale: np.float32,
) -> np.ndarray:
    """Fit weights of the samples before, (order,), that predict moving echoes, by least squares.

    As many tones as weights are predicted without error, at any strength.
    """
    order = min(16, samples.shape[2] // 8)
    per_receiver = max(1, _N_FITTED_SAMPLES // (samples.shape[2] * receivers.size))
    fitted_chirps = quiet_chirps[:: -(-quiet_chirps.size // per_receiver)]
    rows = samples[np.ix_(fitted_chirps, receivers)] * inverse_scale
    rows -= static_samples[np.ix_(fitted_chirps % len(static_samples), receivers)]
    rows = rows.astype(np.complex128 if np.iscomplexobj(rows) else np.float64)
    products = _sum_lag_products(rows.reshape(-1, samples.shape[2]), order)
    autocorrelation, cross_correlation = products[:-1, :-1], products[:-1, -1]
    # Diagonal loading: fitting the rounding error at -144 dB would need huge weights.
    autocorrelation = autocorrelation + (1e-12 * np.trace(autocorrelation).real + 1e-300) * np.eye(
        order
    )
    return np.linalg.solve(autocorrelation, cross_correlation)[::-1]


def _sum_lag_products_in_numpy(rows: np.ndarray, order: int) -> np.ndarray:
    n_whole = rows.shape[1] - order
    out = np.empty((order + 1, order + 1), rows.dtype)
    lagged = sliding_window_view(rows, n_whole, axis=1)
    out[0] = np.einsum("rn,rln->l", rows[:, :n_whole].conj(), lagged)
    out[:, 0] = out[0].conj()
    first, last = rows[:, :order], rows[:, n_whole:]
    end_terms = last.conj().T @ last - first.conj().T @ first
    for i in range(order):
        out[i + 1, 1:] = out[i, :-1] + end_terms[i]
    return out


@kernel(plain=_sum_lag_products_in_numpy)
def _sum_lag_products(rows: np.ndarray, order: int) -> np.ndarray:
    """Return sums over rows and n of conj(x[n + i]) x[n + j], (order + 1, order + 1).

    Only the first row is summed: along a diagonal, sums differ by their first and last terms. (A
    matrix product would use threads, and wait for them on a busy machine.)
    """
    n_whole = rows.shape[1] - order
    out = np.zeros((order + 1, order + 1), rows.dtype)
    for row in rows:
        for lag in range(order + 1):
            total = row.dtype.type(0)
            for n in range(n_whole):
                total += np.conj(row[n]) * row[n + lag]
            out[0, lag] += total
            for i in range(order - lag):
                j = i + lag
                total += np.conj(row[i + n_whole]) * row[j + n_whole] - np.conj(row[i]) * row[j]
                out[i + 1, j + 1] += total
    for i in range(order + 1):
        for j in range(i):
            out[i, j] = np.conj(out[j, i])
    return out


# Without NaN handling, which is not needed here, eight samples are vectorised.
@kernel(fastmath={"contract", "reassoc", "nnan", "nsz"})
def write_prediction_errors(
    parts: np.ndarray, predictor: np.ndarray, n_parts: int, errors: np.ndarray
) -> None:
    """Write prediction errors to white (part, sample), in one pass for each weight."""
    order, n_whole = predictor.shape[1], errors.shape[1]
    white_x, white_y = errors[0], errors[1]
    for part in range(n_parts):
        for n in range(n_whole):
            errors[part, n] = parts[part, n + order]
    for j in range(order):
        real, imaginary = predictor[0, j], predictor[1, j]
        start = order - 1 - j
        # Slices, since possibly negative indices prevent vectorisation.
        x, y = parts[0, start : start + n_whole], parts[1, start : start + n_whole]
        if n_parts == 1:
            for n in range(n_whole):
                white_x[n] -= real * x[n]
        else:
            for n in range(n_whole):
                white_x[n] -= real * x[n] - imaginary * y[n]
                white_y[n] -= real * y[n] + imaginary * x[n]
