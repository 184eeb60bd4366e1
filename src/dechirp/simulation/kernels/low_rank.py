"""Low-rank kernel: the beat signal of few scatterers, as a product of chirps and fast time.

With r from -1 to 1 over the sampling window, the echo in chirp m from one transmitter to one
receiver is, from a Taylor series of both ranges about the middle of the window,

    z_m exp(2 pi i (c1_m r + c2_m r^2)) exp(e1_m r + e2_m r^2).

From chirp to chirp c1 and c2 change little. Over a block of chirps, their middles define a table
B(r) = exp 2 pi i (c1 r + c2 r^2) of fast time, for all antenna pairs. The remainder is a short
polynomial, with K complex numbers for each chirp and receiver, in which all transmitters add up:

    echo = B(r) sum_k C_mk r^k,    or out = C T, T the table of B(r) r^k.

K and the length of the blocks minimise the cost. The polynomial is the Taylor series of the
exponential, economised (Lanczos 1956). Its error is below half of the tolerance, for each echo in
each chirp, root mean square over samples, by the sum of the sizes of the dropped terms. That of the
range series is below a quarter, and single precision adds 2e-7.

Scatterers with long series, near and fast ones or those that pass through many range cells within
few chirps, are left to the direct kernel.
"""

import numpy as np

from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.core.phasors import cosine_and_sine
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.simulation.kernels import direct
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.chebyshev import economised_monomials_and_rms_errors
from dechirp.simulation.kernels.simd import (
    VECTOR_BYTES,
    WIDTH,
    set_eight_complex_sums,
    set_two_complex_sums,
)

# Chirps whose ranges are expanded together, scatterers whose tables are held together (in L2 for a
# thousand samples), largest number of terms of a polynomial, and of its Taylor series.
_CHIRP_BATCH, _SCATTERER_BATCH, _MAX_TERMS, _ORDERS = 128, 16, 6, 8
# Coefficients of a term: those of rows after the last chirp are multiplied, too.
_PADDED_BATCH = _CHIRP_BATCH + WIDTH - 1
# Samples of a tile whose sums, of eight chirps, stay in L1. Indices into flat arrays are unsigned
# and offsets added up outside of loops: else the compiler does not vectorise them, 6 times slower.
_TILE = 256
# Scatterers from which the share left to the direct kernel is estimated.
_COST_SAMPLE = 16
# Times in ns per sample: for each term and row; of a table, and for each of its terms; of the
# direct kernel.
_TERM_NS, _TABLE_NS, _ENTRY_NS, _DIRECT_NS = 0.035, 0.7, 0.15, 0.3

_compiled = kernel(fastmath={"contract"})


def add_echoes(
    out: np.ndarray, scatterers: Scatterers, transmission: Transmission, *, tolerance: float = 1e-5
) -> None:
    """Add the echoes of all scatterers to `out`, in place.

    Several threads may each process some of the chirps.

    Parameters
    ----------
    out : (n_chirps, n_rx, n_samples), complex64 or complex128
        Its precision is that of the sums.
    scatterers, transmission
        No scatterer may be at an antenna.
    tolerance : float
        Root mean square error over that of the echoes; 1e-6 at least in single precision.
    """
    factors = scatterers.chirp_factors
    for first in range(0, len(out) if out.size else 0, _CHIRP_BATCH):
        chirps = slice(first, first + _CHIRP_BATCH)
        batch = scatterers._replace(chirp_factors=None if factors is None else factors[chirps])
        batch_transmission = transmission._replace(
            starts_s=transmission.starts_s[chirps], weights=transmission.weights[chirps]
        )
        left_out = _add_suitable_and_mark_others(out[chirps], batch, batch_transmission, tolerance)
        if left_out.any():
            direct.add_echoes(out[chirps], batch.select(left_out), batch_transmission)


def estimate_fraction_cheaper_direct(
    scatterers: Scatterers, transmission: Transmission, n_samples: int, *, tolerance: float = 1e-5
) -> float:
    """Estimate the share of scatterers that `add_echoes` leaves to the direct kernel."""
    n = len(scatterers.amplitudes)
    # Spread over all scatterers, with steps of at least one, so that none repeats.
    batch = np.arange(n) if n <= _COST_SAMPLE else np.linspace(0, n - 1, _COST_SAMPLE).astype(int)
    chirps = slice(0, _CHIRP_BATCH)
    flat, batch_transmission = _unify_array_types(
        scatterers._replace(chirp_factors=None).select(batch),
        transmission._replace(
            starts_s=transmission.starts_s[chirps], weights=transmission.weights[chirps]
        ),
    )
    return float(_fraction_cheaper_direct(flat, batch_transmission, n_samples, float(tolerance)))


def _add_suitable_and_mark_others(
    out: np.ndarray, scatterers: Scatterers, transmission: Transmission, tolerance: float
) -> np.ndarray:
    """Add scatterers with short series; return a mask of the others, (n_scatterers,)."""
    n = len(scatterers.amplitudes)
    left_out = np.zeros(n, np.bool_)
    flat, batch_transmission = _unify_array_types(scatterers, transmission)
    precision = out.real.dtype
    sums = _empty_with_aligned_start(WIDTH * 2 * _TILE, precision)
    tables = _empty_with_aligned_start(
        min(_SCATTERER_BATCH, n) * _MAX_TERMS * 2 * _round_up_to_tiles(out.shape[2]), precision
    )
    _add_scatterer_batches(out, flat, batch_transmission, float(tolerance), sums, tables, left_out)
    return left_out


def _unify_array_types(
    scatterers: Scatterers, transmission: Transmission
) -> tuple[Scatterers, Transmission]:
    """Convert arrays to fixed types, so that functions compile once."""
    path_m, amplitudes, tx_gains, rx_gains, factors = scatterers
    n = len(amplitudes)
    flat = Scatterers(
        np.ascontiguousarray(path_m, float),
        np.ascontiguousarray(amplitudes, float),
        np.ascontiguousarray(tx_gains, float),
        np.ascontiguousarray(rx_gains, float),
        np.ones((1, n)) if factors is None else np.ascontiguousarray(factors, float),
    )
    batch_transmission = Transmission(
        np.ascontiguousarray(transmission.starts_s, float),
        np.ascontiguousarray(transmission.weights, complex),
        np.ascontiguousarray(transmission.tx_m, float),
        np.ascontiguousarray(transmission.rx_m, float),
        *map(float, transmission[4:]),
    )
    return flat, batch_transmission


def _empty_with_aligned_start(size: int, dtype: np.dtype) -> np.ndarray:
    """Return memory from a multiple of 64 bytes on: unaligned vectors take twice as long."""
    room = np.empty(size * dtype.itemsize + 64, np.uint8)
    first = -room.ctypes.data % 64
    return room[first : first + size * dtype.itemsize].view(dtype)


def _economisation_tables() -> tuple[np.ndarray, np.ndarray]:
    """Tabulate `economised_monomials_and_rms_errors` for all numbers K of terms.

    Shapes: (K, k, power) and (K, power).
    """
    retained, dropped = (
        np.zeros((_MAX_TERMS + 1, _MAX_TERMS, _ORDERS)),
        np.zeros((_MAX_TERMS + 1, _ORDERS)),
    )
    for n_terms in range(1, _MAX_TERMS + 1):
        retained[n_terms, :n_terms], dropped[n_terms] = economised_monomials_and_rms_errors(
            n_terms, _ORDERS
        )
    return retained, dropped


_RETAINED, _DROPPED = _economisation_tables()


@kernel(plain=IN_CALLER, fastmath={"contract"})
def _round_up_to_tiles(n_samples: int) -> int:
    return (n_samples + _TILE - 1) // _TILE * _TILE


@kernel(plain=IN_CALLER, fastmath={"contract"})
def _add_scatterer_batches(
    out: np.ndarray,
    scatterers: Scatterers,
    transmission: Transmission,
    tolerance: float,
    sums: np.ndarray,
    tables: np.ndarray,
    left_out: np.ndarray,
) -> None:
    """Process batches of scatterers: terms and blocks, coefficients, tables, and the product."""
    n_chirps, n_rx, n_samples = out.shape
    n_scatterers = len(left_out)
    ramp = _ramp_and_window_parameters(transmission, n_samples)
    slot_transmitters, slot_positions_m = _slot_transmitters_and_positions(transmission)
    times_s = transmission.starts_s + ramp[2]
    local, echo = np.empty((9, _CHIRP_BATCH)), np.empty((6, _CHIRP_BATCH))
    outbound, inbound = (
        np.empty((len(slot_positions_m), 6, _CHIRP_BATCH)),
        np.empty((n_rx, 6, _CHIRP_BATCH)),
    )
    sent = np.empty((len(slot_positions_m), 2, _CHIRP_BATCH))
    n_levels = _count_power_of_two_block_counts(n_chirps)
    order, bends = np.empty(_SCATTERER_BATCH, np.int64), np.empty(_SCATTERER_BATCH)
    lows, highs = (
        np.empty((_SCATTERER_BATCH, _CHIRP_BATCH)),
        np.empty((_SCATTERER_BATCH, _CHIRP_BATCH)),
    )
    n_terms_needed, costs = (
        np.empty((_SCATTERER_BATCH, n_levels), np.int64),
        np.empty((_SCATTERER_BATCH, n_levels)),
    )
    max_coefficients = min(_SCATTERER_BATCH, n_scatterers) * _MAX_TERMS
    coefficients = np.zeros(max_coefficients * 2 * n_rx * _PADDED_BATCH, tables.dtype)
    powers = np.empty((_ORDERS, 2, _CHIRP_BATCH), tables.dtype)
    direct_ns = _DIRECT_NS * n_rx * n_chirps * len(slot_positions_m) * n_samples
    for first in range(0, n_scatterers, _SCATTERER_BATCH):
        n = 0
        for i in range(first, min(first + _SCATTERER_BATCH, n_scatterers)):
            _expand_scatterer_ranges(
                scatterers.path_m,
                i,
                times_s,
                ramp,
                slot_positions_m,
                transmission.rx_m,
                local,
                outbound,
                inbound,
            )
            remainder = _range_truncation_error(
                scatterers.path_m, i, times_s, local, outbound, inbound, ramp
            )
            e1, g2, bends[n] = _bound_phase_and_amplitude_coefficients(
                n_chirps, outbound, inbound, ramp, echo, lows[n], highs[n]
            )
            _fill_terms_and_costs_per_block_count(
                lows[n],
                highs[n],
                out.shape,
                e1,
                g2,
                remainder,
                tolerance,
                n_terms_needed[n],
                costs[n],
            )
            left_out[i] = _cheapest_block_count_level_and_cost(costs, n, n + 1)[1] > direct_ns
            if not left_out[i]:
                order[n] = i
                n += 1
        level, _ = _cheapest_block_count_level_and_cost(costs, 0, n)
        length = -(-n_chirps // (1 << level))
        n_terms = 0
        for index in range(n):
            i = order[index]
            _replace_linear_phase_by_block_middle(lows[index], highs[index], n_chirps, length)
            _expand_scatterer_ranges(
                scatterers.path_m,
                i,
                times_s,
                ramp,
                slot_positions_m,
                transmission.rx_m,
                local,
                outbound,
                inbound,
            )
            _fill_sent_amplitudes(scatterers, i, transmission.weights, slot_transmitters, sent)
            for path in range(n_rx * len(slot_positions_m)):
                k, s = path // len(slot_positions_m), path % len(slot_positions_m)
                _expand_phases_and_amplitudes(n_chirps, outbound, s, inbound, k, ramp, echo)
                _add_transmitter_to_coefficients(
                    n_chirps, echo, sent[s], scatterers.rx_gains[k, i], lows[index], bends[index],
                    n_terms_needed[index, level], powers, coefficients, n_terms, n_rx, k, s == 0,
                )  # fmt: skip
            n_terms += n_terms_needed[index, level]
        for start in range(0, n_chirps, length):
            term = 0
            for index in range(n):
                n_more = n_terms_needed[index, level]
                _tabulate_quadratic_phasors_times_powers(
                    lows[index, start], bends[index], n_samples, n_more, tables, term
                )
                term += n_more
            stop = min(start + length, n_chirps)
            _add_coefficients_times_tables(out, start, stop, tables, n_terms, coefficients, sums)


@kernel(plain=IN_CALLER, fastmath={"contract"})
def _fraction_cheaper_direct(
    scatterers: Scatterers, transmission: Transmission, n_samples: int, tolerance: float
) -> float:
    """Return the share of the scatterers that `_add_scatterer_batches` leaves out."""
    n_scatterers, n_chirps, n_rx = (
        len(scatterers.amplitudes),
        len(transmission.weights),
        len(transmission.rx_m),
    )
    ramp = _ramp_and_window_parameters(transmission, n_samples)
    _, slot_positions_m = _slot_transmitters_and_positions(transmission)
    times_s = transmission.starts_s + ramp[2]
    local, echo = np.empty((9, _CHIRP_BATCH)), np.empty((6, _CHIRP_BATCH))
    outbound, inbound = (
        np.empty((len(slot_positions_m), 6, _CHIRP_BATCH)),
        np.empty((n_rx, 6, _CHIRP_BATCH)),
    )
    low, high, n_levels = (
        np.empty(_CHIRP_BATCH),
        np.empty(_CHIRP_BATCH),
        _count_power_of_two_block_counts(n_chirps),
    )
    n_terms_needed, costs = np.empty(n_levels, np.int64), np.empty((1, n_levels))
    direct_ns = _DIRECT_NS * n_rx * n_chirps * len(slot_positions_m) * n_samples
    n_left = 0
    for i in range(n_scatterers):
        _expand_scatterer_ranges(
            scatterers.path_m,
            i,
            times_s,
            ramp,
            slot_positions_m,
            transmission.rx_m,
            local,
            outbound,
            inbound,
        )
        remainder = _range_truncation_error(
            scatterers.path_m, i, times_s, local, outbound, inbound, ramp
        )
        e1, g2, _ = _bound_phase_and_amplitude_coefficients(
            n_chirps, outbound, inbound, ramp, echo, low, high
        )
        shape = (n_chirps, n_rx, n_samples)
        _fill_terms_and_costs_per_block_count(
            low, high, shape, e1, g2, remainder, tolerance, n_terms_needed, costs[0]
        )
        n_left += _cheapest_block_count_level_and_cost(costs, 0, 1)[1] > direct_ns
    return n_left / n_scatterers


@_compiled
def _count_power_of_two_block_counts(n_chirps: int) -> int:
    """Return how many numbers of blocks to compare: one, two, four ... up to one per chirp."""
    n_levels = 1
    while 1 << (n_levels - 1) < n_chirps:
        n_levels += 1
    return n_levels


@_compiled
def _ramp_and_window_parameters(
    transmission: Transmission, n_samples: int
) -> tuple[float, float, float, float]:
    """Return start and slope of the ramp; middle and half length of the window."""
    half_s = n_samples / 2 / transmission.sample_rate_hz
    on_ramp_s = transmission.adc_start_s + (n_samples - 1) / 2 / transmission.sample_rate_hz
    return transmission.start_frequency_hz, transmission.slope_hz_per_s, on_ramp_s, half_s


@_compiled
def _slot_transmitters_and_positions(transmission: Transmission) -> tuple[np.ndarray, np.ndarray]:
    """Return the active transmitters of each chirp, (slot, chirp), and positions, (slot, 3, chirp).

    There are as many slots as simultaneous transmitters; -1 marks an unused one, at the first's
    position.
    """
    n_chirps, n_tx = transmission.weights.shape
    slot_transmitters = np.full((n_tx, _CHIRP_BATCH), -1)
    n_slots = 1
    for m in range(n_chirps):
        used = 0
        for j in range(n_tx):
            if transmission.weights[m, j] != 0:
                slot_transmitters[used, m] = j
                used += 1
        n_slots = max(n_slots, used)
    slot_positions_m = np.empty((n_slots, 3, _CHIRP_BATCH))
    for s in range(n_slots):
        for m in range(n_chirps):
            j = max(slot_transmitters[s if slot_transmitters[s, m] >= 0 else 0, m], 0)
            for axis in range(3):
                slot_positions_m[s, axis, m] = transmission.tx_m[j, axis]
    return slot_transmitters, slot_positions_m


@_compiled
def _cheapest_block_count_level_and_cost(
    costs: np.ndarray, first_scatterer: int, stop_scatterer: int
) -> tuple[int, float]:
    """Return the level with the least total cost of some scatterers, and that cost."""
    level, least = 0, np.inf
    for c in range(costs.shape[1]):
        cost = 0.0
        for index in range(first_scatterer, stop_scatterer):
            cost += costs[index, c]
        if cost < least:
            level, least = c, cost
    return level, least


@_compiled
def _fill_sent_amplitudes(
    scatterers: Scatterers,
    scatterer: int,
    weights: np.ndarray,
    slot_transmitters: np.ndarray,
    amplitudes: np.ndarray,
) -> None:
    """Fill amplitudes times weight and gain of the transmitter of each slot, (slot, 2, chirp)."""
    factors = scatterers.chirp_factors
    assert factors is not None  # `_add_suitable_and_mark_others` makes ones of none
    varied = len(factors) > 1
    for s in range(len(amplitudes)):
        for m in range(len(weights)):
            j = slot_transmitters[s, m]
            size = scatterers.amplitudes[scatterer] * factors[m if varied else 0, scatterer]
            weight = weights[m, j] * scatterers.tx_gains[j, scatterer] if j >= 0 else 0j
            amplitudes[s, 0, m] = size * weight.real
            amplitudes[s, 1, m] = size * weight.imag


@_compiled
def _expand_scatterer_ranges(
    path_terms_m: np.ndarray,
    scatterer: int,
    mid_window_times_s: np.ndarray,
    ramp: tuple[float, float, float, float],
    slot_positions_m: np.ndarray,
    rx_m: np.ndarray,
    position_series: np.ndarray,
    outbound: np.ndarray,
    inbound: np.ndarray,
) -> None:
    """Expand the ranges of one scatterer over the window of each chirp."""
    n, half_s = len(mid_window_times_s), ramp[3]
    position_series[:] = 0
    for axis in range(3):
        for term in range(len(path_terms_m) - 1, -1, -1):
            more_m = path_terms_m[term, scatterer, axis]
            for m in range(n):
                t, v = mid_window_times_s[m], position_series[3 + axis, m]
                position_series[6 + axis, m] = position_series[6 + axis, m] * t + v * half_s
                position_series[3 + axis, m] = v * t + position_series[axis, m] * half_s
                position_series[axis, m] = position_series[axis, m] * t + more_m
    for s in range(len(outbound)):
        for axis in range(3):
            for m in range(n):
                outbound[s, axis, m] = position_series[axis, m] - slot_positions_m[s, axis, m]
        _positions_to_range_series(n, position_series, outbound, s)
    for k in range(len(rx_m)):
        for axis in range(3):
            for m in range(n):
                inbound[k, axis, m] = position_series[axis, m] - rx_m[k, axis]
        _positions_to_range_series(n, position_series, inbound, k)


@_compiled
def _positions_to_range_series(
    n_chirps: int, position_series: np.ndarray, range_series: np.ndarray, antenna: int
) -> None:
    """Convert rows x, y, z to the series of the range, 1 / range, and log-range series."""
    for m in range(n_chirps):
        x, y, z = (
            range_series[antenna, 0, m],
            range_series[antenna, 1, m],
            range_series[antenna, 2, m],
        )
        vx, vy, vz = position_series[3, m], position_series[4, m], position_series[5, m]
        r = np.sqrt(x * x + y * y + z * z)
        inverse = 1 / r
        # Power by power from range^2 = |position|^2.
        r1 = (x * vx + y * vy + z * vz) * inverse
        square = vx * vx + vy * vy + vz * vz
        square += 2 * (
            x * position_series[6, m] + y * position_series[7, m] + z * position_series[8, m]
        )
        r2 = (square - r1 * r1) * (inverse / 2)
        u1 = r1 * inverse
        range_series[antenna, 0, m] = r
        range_series[antenna, 1, m] = r1
        range_series[antenna, 2, m] = r2
        range_series[antenna, 3, m] = inverse
        range_series[antenna, 4, m] = u1
        range_series[antenna, 5, m] = r2 * inverse - u1 * u1 / 2


@_compiled
def _range_truncation_error(
    path_terms_m: np.ndarray,
    scatterer: int,
    mid_window_times_s: np.ndarray,
    position_series: np.ndarray,
    outbound: np.ndarray,
    inbound: np.ndarray,
    ramp: tuple[float, float, float, float],
) -> float:
    """Return a bound on the relative error of the truncated range series.

    A scatterer in straight motion by x ranges is at r sqrt(1 + 2 mu x + x^2), whose terms in x^n
    are
    below 2 / (2 n - 1) (Legendre).
    """
    start_frequency_hz, slope_hz_per_s, on_ramp_s, half_s = ramp
    r, v, a, latest_s = np.inf, 0.0, 0.0, half_s
    for m in range(len(mid_window_times_s)):
        for s in range(len(outbound)):
            r = min(r, outbound[s, 0, m])
        for k in range(len(inbound)):
            r = min(r, inbound[k, 0, m])
        v = max(
            v, position_series[3, m] ** 2 + position_series[4, m] ** 2 + position_series[5, m] ** 2
        )
        a = max(
            a, position_series[6, m] ** 2 + position_series[7, m] ** 2 + position_series[8, m] ** 2
        )
        latest_s = max(latest_s, abs(mid_window_times_s[m]) + half_s)
    v, a, remainder = np.sqrt(v), np.sqrt(a), 0.0
    for term in range(3, len(path_terms_m)):
        x, y, z = (
            path_terms_m[term, scatterer, 0],
            path_terms_m[term, scatterer, 1],
            path_terms_m[term, scatterer, 2],
        )
        series = term * (term - 1) * (term - 2) / 6
        remainder += series * np.sqrt(x * x + y * y + z * z) * latest_s ** (term - 3) * half_s**3
    # Least range within any chirp.
    r -= v + a + remainder
    if r < 2 * v:
        return np.inf
    v, a, remainder = v / r, a / r, remainder / r
    third = remainder + 2 * v * a + 2 / 5 * v**3
    swept_hz = abs(slope_hz_per_s) * half_s
    top_hz = start_frequency_hz + abs(slope_hz_per_s) * (abs(on_ramp_s) + half_s)
    cycles = 2 * r / SPEED_OF_LIGHT * (top_hz * third + swept_hz * (a + 2 / 3 * v**2))
    return float(2 * np.pi * cycles)


@_compiled
def _expand_phases_and_amplitudes(
    n_chirps: int,
    outbound: np.ndarray,
    slot: int,
    inbound: np.ndarray,
    rx: int,
    ramp: tuple[float, float, float, float],
    echo_series: np.ndarray,
) -> None:
    """Fill rows: cycles 0-2, terms 1 and 2 of the logarithm of the size, spreading."""
    start_frequency_hz, slope_hz_per_s, on_ramp_s, half_s = ramp
    swept_hz = slope_hz_per_s * half_s
    for m in range(n_chirps):
        delay_s = (outbound[slot, 0, m] + inbound[rx, 0, m]) / SPEED_OF_LIGHT
        d1 = (outbound[slot, 1, m] + inbound[rx, 1, m]) / SPEED_OF_LIGHT
        d2 = (outbound[slot, 2, m] + inbound[rx, 2, m]) / SPEED_OF_LIGHT
        # Whole cycles are removed before any sum: 26,000 of them at 50 m.
        cycles = start_frequency_hz * delay_s
        cycles -= np.floor(cycles)
        received_hz = start_frequency_hz + slope_hz_per_s * (on_ramp_s - delay_s)
        echo_series[0, m] = cycles + slope_hz_per_s * delay_s * (on_ramp_s - delay_s / 2)
        echo_series[1, m] = received_hz * d1 + swept_hz * delay_s
        echo_series[2, m] = received_hz * d2 + swept_hz * d1 - slope_hz_per_s / 2 * d1 * d1
        echo_series[3, m] = -outbound[slot, 4, m] - inbound[rx, 4, m]
        echo_series[4, m] = -outbound[slot, 5, m] - inbound[rx, 5, m]
        echo_series[5, m] = outbound[slot, 3, m] * inbound[rx, 3, m]


@_compiled
def _bound_phase_and_amplitude_coefficients(
    n_chirps: int,
    outbound: np.ndarray,
    inbound: np.ndarray,
    ramp: tuple[float, float, float, float],
    echo_series: np.ndarray,
    min_c1: np.ndarray,
    max_c1: np.ndarray,
) -> tuple[float, float, float]:
    """Fill the least and largest c1 of each chirp; return |e1|, |g2| and the middle of c2."""
    min_c1[:n_chirps] = np.inf
    max_c1[:n_chirps] = -np.inf
    e1, e2, low2, high2 = 0.0, 0.0, np.inf, -np.inf
    for k in range(len(inbound)):
        for s in range(len(outbound)):
            _expand_phases_and_amplitudes(n_chirps, outbound, s, inbound, k, ramp, echo_series)
            for m in range(n_chirps):
                min_c1[m] = min(min_c1[m], echo_series[1, m])
                max_c1[m] = max(max_c1[m], echo_series[1, m])
            for m in range(n_chirps):
                low2, high2 = min(low2, echo_series[2, m]), max(high2, echo_series[2, m])
                e1, e2 = max(e1, abs(echo_series[3, m])), max(e2, abs(echo_series[4, m]))
    return e1, e2 + np.pi * (high2 - low2), (low2 + high2) / 2


@_compiled
def _fill_terms_and_costs_per_block_count(
    min_c1: np.ndarray,
    max_c1: np.ndarray,
    shape: tuple[int, int, int],
    e1: float,
    g2: float,
    remainder: float,
    tolerance: float,
    n_terms: np.ndarray,
    costs: np.ndarray,
) -> None:
    """Fill the required terms, and the cost in ns, for one, two, four ... blocks."""
    n_chirps, n_rx, n_samples = shape
    n_terms_needed = _MAX_TERMS + 1
    for level in range(len(costs)):
        length = -(-n_chirps // (1 << level))
        if n_terms_needed > 2:
            half = 0.0
            for start in range(0, n_chirps, length):
                least, largest = np.inf, -np.inf
                for m in range(start, min(start + length, n_chirps)):
                    least, largest = min(least, min_c1[m]), max(largest, max_c1[m])
                half = max(half, (largest - least) / 2)
            n_terms_needed = _required_exponential_series_terms(
                e1 + 2 * np.pi * half, g2, tolerance / 2
            )
        n_blocks = -(-n_chirps // length)
        n_terms[level] = n_terms_needed
        costs[level] = np.inf
        if n_terms_needed <= _MAX_TERMS and remainder <= tolerance / 4:
            table_ns = n_blocks * (_TABLE_NS + n_terms_needed * _ENTRY_NS)
            costs[level] = _round_up_to_tiles(n_samples) * (
                n_terms_needed * n_chirps * n_rx * _TERM_NS + table_ns
            )


@_compiled
def _required_exponential_series_terms(
    linear_coefficient: float, quadratic_coefficient: float, tolerance: float
) -> int:
    """Return the terms, 2 or more, for exp(g1 r + g2 r^2); _MAX_TERMS + 1 if too many."""
    # The remainder of the Taylor series is below twice its first term.
    linear_coefficient = min(linear_coefficient, 4.0)
    series = np.empty(_ORDERS + 1)
    series[0], series[1] = 1.0, linear_coefficient
    for q in range(2, _ORDERS + 1):
        series[q] = (
            linear_coefficient * series[q - 1] + 2 * quadratic_coefficient * series[q - 2]
        ) / q
    for n_terms in range(2, _MAX_TERMS + 1):
        orders = min(n_terms + 2, _ORDERS)
        error = 2 * series[orders]
        for q in range(n_terms, orders):
            error += _DROPPED[n_terms, q] * series[q]
        if error <= tolerance:
            return n_terms
    return _MAX_TERMS + 1


@_compiled
def _replace_linear_phase_by_block_middle(
    min_c1: np.ndarray, max_c1: np.ndarray, n_chirps: int, chirps_per_block: int
) -> None:
    """Store the middle of c1 of each block in `min_c1` of its chirps."""
    for start in range(0, n_chirps, chirps_per_block):
        stop = min(start + chirps_per_block, n_chirps)
        least, largest = np.inf, -np.inf
        for m in range(start, stop):
            least, largest = min(least, min_c1[m]), max(largest, max_c1[m])
        for m in range(start, stop):
            min_c1[m] = (least + largest) / 2


@_compiled
def _add_transmitter_to_coefficients(
    n_chirps: int,
    echo_series: np.ndarray,
    sent: np.ndarray,
    rx_gain: float,
    middle_c1: np.ndarray,
    middle_c2: float,
    n_terms: int,
    powers: np.ndarray,
    coefficients: np.ndarray,
    first_term: int,
    n_rx: int,
    rx: int,
    overwrite: bool,
) -> None:
    """Add one transmitter's share to the coefficients of the echo in each chirp on receiver k."""
    for m in range(n_chirps):
        real, imag = cosine_and_sine(echo_series[0, m])
        size = rx_gain * echo_series[5, m]
        powers[0, 0, m] = size * (real * sent[0, m] - imag * sent[1, m])
        powers[0, 1, m] = size * (real * sent[1, m] + imag * sent[0, m])
        echo_series[1, m] = 2 * np.pi * (echo_series[1, m] - middle_c1[m])
        echo_series[2, m] = 4 * np.pi * (echo_series[2, m] - middle_c2)
        echo_series[4, m] *= 2
    orders = min(n_terms + 2, _ORDERS)
    for q in range(1, orders):
        share = 1 / q
        for m in range(n_chirps):
            e1, c1 = echo_series[3, m], echo_series[1, m]
            real = powers[q - 1, 0, m] * e1 - powers[q - 1, 1, m] * c1
            imag = powers[q - 1, 1, m] * e1 + powers[q - 1, 0, m] * c1
            powers[q, 0, m] = share * real
            powers[q, 1, m] = share * imag
        if q > 1:
            for m in range(n_chirps):
                e2, c2 = share * echo_series[4, m], share * echo_series[2, m]
                real = powers[q - 2, 0, m] * e2 - powers[q - 2, 1, m] * c2
                imag = powers[q - 2, 1, m] * e2 + powers[q - 2, 0, m] * c2
                powers[q, 0, m] += real
                powers[q, 1, m] += imag
    for term in range(n_terms):
        for part in range(2):
            row = np.uint64((((first_term + term) * 2 + part) * n_rx + rx) * _PADDED_BATCH)
            if overwrite:
                for m in range(np.uint64(n_chirps)):
                    coefficients[row + m] = 0
            for q in range(term, orders):
                retained = _RETAINED[n_terms, term, q]
                if retained != 0:
                    for m in range(np.uint64(n_chirps)):
                        coefficients[row + m] += retained * powers[q, part, m]


@_compiled
def _tabulate_quadratic_phasors_times_powers(
    c1: float, c2: float, n_samples: int, n_terms: int, tables: np.ndarray, first_term: int
) -> None:
    """Fill rows of `tables`: real and imaginary part of B(r), then of B(r) r ..."""
    stride = _round_up_to_tiles(n_samples)
    step, half = 2 / n_samples, (n_samples - 1) / n_samples
    pitch = np.uint64(stride)
    real = np.uint64(2 * first_term * stride)
    imag = real + pitch
    for x in range(pitch):
        r = step * x - half
        cosine, sine = cosine_and_sine(r * (c1 + r * c2))
        tables[real + x] = cosine
        tables[imag + x] = sine
    for k in range(1, n_terms):
        last_real = np.uint64(2 * (first_term + k - 1) * stride)
        last_imag = last_real + pitch
        real = last_imag + pitch
        imag = real + pitch
        for x in range(pitch):
            r = step * x - half
            tables[real + x] = r * tables[last_real + x]
            tables[imag + x] = r * tables[last_imag + x]


@_compiled
def _add_coefficients_times_tables(
    out: np.ndarray,
    first_chirp: int,
    stop_chirp: int,
    tables: np.ndarray,
    n_terms: int,
    coefficients: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Add the product of coefficients and tables to some chirps of `out`."""
    _, n_rx, n_samples = out.shape
    pitch, stride = n_rx * _PADDED_BATCH, _round_up_to_tiles(n_samples)
    for k in range(n_rx):
        for m0 in range(first_chirp, stop_chirp, WIDTH):
            for x0 in range(0, n_samples, _TILE):
                m1 = min(m0 + WIDTH, stop_chirp)
                for x in range(0, _TILE, VECTOR_BYTES // sums.itemsize):
                    factor, entry = k * _PADDED_BATCH + m0, x0 + x
                    if m1 - m0 > WIDTH // 2:
                        set_eight_complex_sums(
                            sums, x, _TILE, coefficients, factor, pitch,
                            tables, entry, stride, n_terms,
                        )  # fmt: skip
                    else:
                        for row in range(0, m1 - m0, 2):
                            set_two_complex_sums(
                                sums, 2 * row * _TILE + x, _TILE, coefficients, factor + row, pitch,
                                tables, entry, stride, n_terms,
                            )  # fmt: skip
                n, first = np.uint64(min(_TILE, n_samples - x0)), np.uint64(x0)
                for m in range(m0, m1):
                    chirp, antenna = np.uint64(m), np.uint64(k)
                    real = np.uint64(2 * (m - m0) * _TILE)
                    imag = real + np.uint64(_TILE)
                    for x in range(n):
                        out[chirp, antenna, first + x] += complex(sums[real + x], sums[imag + x])
