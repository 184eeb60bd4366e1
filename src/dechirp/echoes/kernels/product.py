"""The beat signal of few scatterers, as a low-rank product of chirps and fast time.

With r from -1 to 1 over the sampling window, the echo in chirp m from one transmitter to one
receiver is, from a Taylor series of both ways about the middle of the window,

    z_m exp(2 pi i (c1_m r + c2_m r^2)) exp(e1_m r + e2_m r^2).

From chirp to chirp c1 and c2 change little. Over a block of chirps their middles make one
table B(r) = exp 2 pi i (c1 r + c2 r^2) of fast time, for all pairs of antennas. What is left
is a short polynomial, with K complex numbers a chirp and receiver into which all transmitters
add up:

    echo = B(r) sum_k C_mk r^k,    or out = C T, T the table of B(r) r^k.

K and the length of the blocks are those that cost least. The polynomial is the Taylor series
of the exponential, economised (Lanczos 1956). Its error is below half of the tolerance, for
each echo in each chirp, root mean square over samples: by the sum of the sizes of the terms
dropped. That of the series of the ways is below a quarter, and single precision adds 2e-7.

Scatterers whose series are not short, near and fast ones or those that pass through many
range cells within few chirps, are left to the direct kernel.
"""

import numba
import numpy as np

from dechirp.core.turns import cosine_and_sine
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.echoes.kernels import direct
from dechirp.echoes.kernels.base import Scatterers, Sent
from dechirp.echoes.kernels.economised import economised

# Chirps whose ways are expanded together, scatterers whose tables are held together (in L2 for
# a thousand samples), most terms of a polynomial, and of the Taylor series that it comes from.
_LANES, _TOGETHER, _MOST, _ORDERS = 128, 16, 6, 8
# Sums of so many chirps and samples are held in L1. Indices into flat arrays are unsigned and
# offsets added up outside of loops: else the compiler makes no vectors of them, 6 times slower.
_ROWS, _TILE = 8, 256
# Scatterers from which it is told how many are left to the direct kernel.
_LOOK = 16
# ns a sample: for each term and row; of a table, and for each of its terms; of the direct kernel.
_TERM_NS, _TABLE_NS, _ENTRY_NS, _DIRECT_NS = 0.035, 0.7, 0.15, 0.3

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})


def add(out: np.ndarray, scatterers: Scatterers, sent: Sent, *, tolerance: float = 1e-5) -> None:
    """Add the echoes of all scatterers to `out`, in place.

    Several threads may each add to a part of the chirps.

    Parameters
    ----------
    out : (n_chirps, n_rx, n_samples), complex64 or complex128
        Its precision is that of the sums.
    scatterers, sent
        None of the scatterers at an antenna.
    tolerance : float
        Root mean square error over that of the echoes; 1e-6 at least in single precision.
    """
    factors = scatterers.chirp_factors
    for first in range(0, len(out) if out.size else 0, _LANES):
        chirps = slice(first, first + _LANES)
        some = scatterers._replace(chirp_factors=None if factors is None else factors[chirps])
        then = sent._replace(starts_s=sent.starts_s[chirps], weights=sent.weights[chirps])
        left = _add_short(out[chirps], some, then, tolerance)
        if left.any():
            direct.add(out[chirps], _only(some, left), then)


def handed_over(
    scatterers: Scatterers, sent: Sent, n_samples: int, *, tolerance: float = 1e-5
) -> float:
    """Share of the scatterers that `add` leaves to the direct kernel, from some of them."""
    n = len(scatterers.amplitudes)
    # Spread over all; steps of one or more, so that none comes twice.
    some = np.arange(n) if n <= _LOOK else np.linspace(0, n - 1, _LOOK).astype(int)
    chirps = slice(0, _LANES)
    flat, then = _of_one_type(
        _only(scatterers._replace(chirp_factors=None), some),
        sent._replace(starts_s=sent.starts_s[chirps], weights=sent.weights[chirps]),
    )
    return float(_handed_over(flat, then, n_samples, float(tolerance)))


def _only(scatterers: Scatterers, which: np.ndarray) -> Scatterers:
    factors = scatterers.chirp_factors
    return Scatterers(
        scatterers.path_m[:, which],
        scatterers.amplitudes[which],
        scatterers.tx_gains[:, which],
        scatterers.rx_gains[:, which],
        None if factors is None else factors[:, which],
    )


def _add_short(out: np.ndarray, scatterers: Scatterers, sent: Sent, tolerance: float) -> np.ndarray:
    """Add those whose series are short; (n_scatterers,): which others there are."""
    n = len(scatterers.amplitudes)
    left = np.zeros(n, np.bool_)
    flat, then = _of_one_type(scatterers, sent)
    precision = out.real.dtype
    sums = _aligned(_ROWS * 2 * _TILE, precision)
    tables = _aligned(min(_TOGETHER, n) * _MOST * 2 * _whole_tiles(out.shape[2]), precision)
    _add(out, flat, then, float(tolerance), sums, tables, left)
    return left


def _of_one_type(scatterers: Scatterers, sent: Sent) -> tuple[Scatterers, Sent]:
    """Arrays of one type each whatever is given: one compilation."""
    path_m, amplitudes, tx_gains, rx_gains, factors = scatterers
    n = len(amplitudes)
    flat = Scatterers(
        np.ascontiguousarray(path_m, float),
        np.ascontiguousarray(amplitudes, float),
        np.ascontiguousarray(tx_gains, float),
        np.ascontiguousarray(rx_gains, float),
        np.ones((1, n)) if factors is None else np.ascontiguousarray(factors, float),
    )
    then = Sent(
        np.ascontiguousarray(sent.starts_s, float),
        np.ascontiguousarray(sent.weights, complex),
        np.ascontiguousarray(sent.tx_m, float),
        np.ascontiguousarray(sent.rx_m, float),
        *map(float, sent[4:]),
    )
    return flat, then


def _aligned(size: int, dtype: np.dtype) -> np.ndarray:
    """From a multiple of 64 bytes on: a vector across two lines takes twice."""
    room = np.empty(size * dtype.itemsize + 64, np.uint8)
    first = -room.ctypes.data % 64
    return room[first : first + size * dtype.itemsize].view(dtype)


def _tables() -> tuple[np.ndarray, np.ndarray]:
    """(K, k, power) and (K, power): what `economised` says of every number K of terms."""
    kept, dropped = np.zeros((_MOST + 1, _MOST, _ORDERS)), np.zeros((_MOST + 1, _ORDERS))
    for n_terms in range(1, _MOST + 1):
        kept[n_terms, :n_terms], dropped[n_terms] = economised(n_terms, _ORDERS)
    return kept, dropped


_KEPT, _DROPPED = _tables()


@_compiled
def _whole_tiles(n_samples: int) -> int:
    return (n_samples + _TILE - 1) // _TILE * _TILE


@_compiled
def _add(
    out: np.ndarray,
    scatterers: Scatterers,
    sent: Sent,
    tolerance: float,
    sums: np.ndarray,
    tables: np.ndarray,
    left: np.ndarray,
) -> None:
    """Some scatterers at a time: their terms and blocks, coefficients, tables, and the product."""
    n_chirps, n_rx, n_samples = out.shape
    n_scatterers = len(left)
    law = _law(sent, n_samples)
    which, from_m = _slots(sent)
    times_s = sent.starts_s + law[2]
    local, echo = np.empty((9, _LANES)), np.empty((7, _LANES))
    there, back = np.empty((len(from_m), 6, _LANES)), np.empty((n_rx, 6, _LANES))
    n_levels = _n_levels(n_chirps)
    order, bends = np.empty(_TOGETHER, np.int64), np.empty(_TOGETHER)
    lows, highs = np.empty((_TOGETHER, _LANES)), np.empty((_TOGETHER, _LANES))
    needed, costs = np.empty((_TOGETHER, n_levels), np.int64), np.empty((_TOGETHER, n_levels))
    most = min(_TOGETHER, n_scatterers) * _MOST
    # One more chirp, for the last of an odd number is multiplied beside nothing.
    coefficients = np.zeros(most * 2 * n_rx * (_LANES + 1), tables.dtype)
    powers = np.empty((_ORDERS, 2, _LANES), tables.dtype)
    direct_ns = _DIRECT_NS * n_rx * n_chirps * len(from_m) * n_samples
    for first in range(0, n_scatterers, _TOGETHER):
        n = 0
        for i in range(first, min(first + _TOGETHER, n_scatterers)):
            _ways(scatterers.path_m, i, times_s, law, from_m, sent.rx_m, local, there, back)
            rest = _left_out(scatterers.path_m, i, times_s, local, there, back, law)
            e1, g2, bends[n] = _spreads(n_chirps, there, back, law, echo, lows[n], highs[n])
            _levels(lows[n], highs[n], out.shape, e1, g2, rest, tolerance, needed[n], costs[n])
            left[i] = _cheapest(costs, n, n + 1)[1] > direct_ns
            if not left[i]:
                order[n] = i
                n += 1
        level, _ = _cheapest(costs, 0, n)
        length = -(-n_chirps // (1 << level))
        n_terms = 0
        for at in range(n):
            i = order[at]
            _middles(lows[at], highs[at], n_chirps, length)
            _ways(scatterers.path_m, i, times_s, law, from_m, sent.rx_m, local, there, back)
            for path in range(n_rx * len(from_m)):
                k, s = path // len(from_m), path % len(from_m)
                _phases(n_chirps, there, s, back, k, law, echo)
                _weigh(scatterers, i, sent.weights, which, s, k, echo)
                _polynomials(
                    n_chirps, echo, lows[at], bends[at], needed[at, level], powers,
                    coefficients, n_terms, n_rx, k, s == 0,
                )  # fmt: skip
            n_terms += needed[at, level]
        for start in range(0, n_chirps, length):
            term = 0
            for at in range(n):
                more = needed[at, level]
                _table(lows[at, start], bends[at], n_samples, more, tables, term)
                term += more
            stop = min(start + length, n_chirps)
            _multiply(out, start, stop, tables, n_terms, coefficients, sums)


@_compiled
def _handed_over(scatterers: Scatterers, sent: Sent, n_samples: int, tolerance: float) -> float:
    """Share of the scatterers that `_add` leaves out."""
    n_scatterers, n_chirps, n_rx = len(scatterers.amplitudes), len(sent.weights), len(sent.rx_m)
    law = _law(sent, n_samples)
    _, from_m = _slots(sent)
    times_s = sent.starts_s + law[2]
    local, echo = np.empty((9, _LANES)), np.empty((7, _LANES))
    there, back = np.empty((len(from_m), 6, _LANES)), np.empty((n_rx, 6, _LANES))
    low, high, n_levels = np.empty(_LANES), np.empty(_LANES), _n_levels(n_chirps)
    needed, costs = np.empty(n_levels, np.int64), np.empty((1, n_levels))
    direct_ns = _DIRECT_NS * n_rx * n_chirps * len(from_m) * n_samples
    n_left = 0
    for i in range(n_scatterers):
        _ways(scatterers.path_m, i, times_s, law, from_m, sent.rx_m, local, there, back)
        rest = _left_out(scatterers.path_m, i, times_s, local, there, back, law)
        e1, g2, _ = _spreads(n_chirps, there, back, law, echo, low, high)
        shape = (n_chirps, n_rx, n_samples)
        _levels(low, high, shape, e1, g2, rest, tolerance, needed, costs[0])
        n_left += _cheapest(costs, 0, 1)[1] > direct_ns
    return n_left / n_scatterers


@_compiled
def _n_levels(n_chirps: int) -> int:
    """Numbers of blocks to choose from: one, two, four ... up to one a chirp."""
    n_levels = 1
    while 1 << (n_levels - 1) < n_chirps:
        n_levels += 1
    return n_levels


@_compiled
def _law(sent: Sent, n_samples: int) -> tuple[float, float, float, float]:
    """Start and slope of the ramp; middle and half length of the window."""
    half_s = n_samples / 2 / sent.sample_rate_hz
    on_ramp_s = sent.adc_start_s + (n_samples - 1) / 2 / sent.sample_rate_hz
    return sent.start_frequency_hz, sent.slope_hz_per_s, on_ramp_s, half_s


@_compiled
def _slots(sent: Sent) -> tuple[np.ndarray, np.ndarray]:
    """Which transmitters send of each chirp, (slot, chirp), and from where, (slot, 3, chirp).

    As many slots as ever send at once; -1: none, as if at the place of the first.
    """
    n_chirps, n_tx = sent.weights.shape
    which = np.full((n_tx, _LANES), -1)
    n_slots = 1
    for m in range(n_chirps):
        used = 0
        for j in range(n_tx):
            if sent.weights[m, j] != 0:
                which[used, m] = j
                used += 1
        n_slots = max(n_slots, used)
    from_m = np.empty((n_slots, 3, _LANES))
    for s in range(n_slots):
        for m in range(n_chirps):
            j = max(which[s if which[s, m] >= 0 else 0, m], 0)
            for axis in range(3):
                from_m[s, axis, m] = sent.tx_m[j, axis]
    return which, from_m


@_compiled
def _cheapest(costs: np.ndarray, first: int, stop: int) -> tuple[int, float]:
    """Level that costs some scatterers least, and how much."""
    level, least = 0, np.inf
    for c in range(costs.shape[1]):
        cost = 0.0
        for at in range(first, stop):
            cost += costs[at, c]
        if cost < least:
            level, least = c, cost
    return level, least


@_compiled
def _weigh(
    scatterers: Scatterers,
    i: int,
    weights: np.ndarray,
    which: np.ndarray,
    s: int,
    k: int,
    echo: np.ndarray,
) -> None:
    """From the spreading, the size of the echo times what is sent: rows 5 and 6 of `echo`."""
    fixed, factors = scatterers.amplitudes[i] * scatterers.rx_gains[k, i], scatterers.chirp_factors
    assert factors is not None  # `_add_short` makes ones of none
    varied = len(factors) > 1
    for m in range(len(weights)):
        j = which[s, m]
        weight = 0j
        if j >= 0:
            weight = weights[m, j] * scatterers.tx_gains[j, i]
        size = fixed * factors[m if varied else 0, i] * echo[5, m]
        echo[5, m] = size * weight.real
        echo[6, m] = size * weight.imag


@_compiled
def _ways(
    path_m: np.ndarray,
    i: int,
    times_s: np.ndarray,
    law: tuple[float, float, float, float],
    from_m: np.ndarray,
    rx_m: np.ndarray,
    local: np.ndarray,
    there: np.ndarray,
    back: np.ndarray,
) -> None:
    """Series over the window of each chirp, to and from one scatterer; see `_way`."""
    n, half_s = len(times_s), law[3]
    local[:] = 0
    for axis in range(3):
        for term in range(len(path_m) - 1, -1, -1):
            more_m = path_m[term, i, axis]
            for m in range(n):
                t, v = times_s[m], local[3 + axis, m]
                local[6 + axis, m] = local[6 + axis, m] * t + v * half_s
                local[3 + axis, m] = v * t + local[axis, m] * half_s
                local[axis, m] = local[axis, m] * t + more_m
    for s in range(len(there)):
        for axis in range(3):
            for m in range(n):
                there[s, axis, m] = local[axis, m] - from_m[s, axis, m]
        _way(n, local, there, s)
    for k in range(len(rx_m)):
        for axis in range(3):
            for m in range(n):
                back[k, axis, m] = local[axis, m] - rx_m[k, axis]
        _way(n, local, back, k)


@_compiled
def _way(n: int, local: np.ndarray, ways: np.ndarray, k: int) -> None:
    """From rows x, y, z to the series of the range, 1 / range, and that of its logarithm."""
    for m in range(n):
        x, y, z = ways[k, 0, m], ways[k, 1, m], ways[k, 2, m]
        vx, vy, vz = local[3, m], local[4, m], local[5, m]
        r = np.sqrt(x * x + y * y + z * z)
        inverse = 1 / r
        # Power by power from range^2 = |position|^2.
        r1 = (x * vx + y * vy + z * vz) * inverse
        square = vx * vx + vy * vy + vz * vz
        square += 2 * (x * local[6, m] + y * local[7, m] + z * local[8, m])
        r2 = (square - r1 * r1) * (inverse / 2)
        u1 = r1 * inverse
        ways[k, 0, m] = r
        ways[k, 1, m] = r1
        ways[k, 2, m] = r2
        ways[k, 3, m] = inverse
        ways[k, 4, m] = u1
        ways[k, 5, m] = r2 * inverse - u1 * u1 / 2


@_compiled
def _left_out(
    path_m: np.ndarray,
    i: int,
    times_s: np.ndarray,
    local: np.ndarray,
    there: np.ndarray,
    back: np.ndarray,
    law: tuple[float, float, float, float],
) -> float:
    """At most how much of an echo the series of the ways leave out.

    Moving straight by x ranges, a scatterer is at r sqrt(1 + 2 mu x + x^2), whose terms in x^n
    are below 2 / (2 n - 1) (Legendre).
    """
    start_frequency_hz, slope_hz_per_s, on_ramp_s, half_s = law
    r, v, a, latest_s = np.inf, 0.0, 0.0, half_s
    for m in range(len(times_s)):
        for s in range(len(there)):
            r = min(r, there[s, 0, m])
        for k in range(len(back)):
            r = min(r, back[k, 0, m])
        v = max(v, local[3, m] ** 2 + local[4, m] ** 2 + local[5, m] ** 2)
        a = max(a, local[6, m] ** 2 + local[7, m] ** 2 + local[8, m] ** 2)
        latest_s = max(latest_s, abs(times_s[m]) + half_s)
    v, a, rest = np.sqrt(v), np.sqrt(a), 0.0
    for term in range(3, len(path_m)):
        x, y, z = path_m[term, i, 0], path_m[term, i, 1], path_m[term, i, 2]
        ways = term * (term - 1) * (term - 2) / 6
        rest += ways * np.sqrt(x * x + y * y + z * z) * latest_s ** (term - 3) * half_s**3
    # Nearest within any chirp.
    r -= v + a + rest
    if r < 2 * v:
        return np.inf
    v, a, rest = v / r, a / r, rest / r
    third = rest + 2 * v * a + 2 / 5 * v**3
    swept_hz = abs(slope_hz_per_s) * half_s
    top_hz = start_frequency_hz + abs(slope_hz_per_s) * (abs(on_ramp_s) + half_s)
    cycles = 2 * r / SPEED_OF_LIGHT * (top_hz * third + swept_hz * (a + 2 / 3 * v**2))
    return float(2 * np.pi * cycles)


@_compiled
def _phases(
    n: int,
    there: np.ndarray,
    s: int,
    back: np.ndarray,
    k: int,
    law: tuple[float, float, float, float],
    echo: np.ndarray,
) -> None:
    """Rows of `echo`: cycles 0-2, terms 1 and 2 of the logarithm of the size, spreading."""
    start_frequency_hz, slope_hz_per_s, on_ramp_s, half_s = law
    swept_hz = slope_hz_per_s * half_s
    for m in range(n):
        delay_s = (there[s, 0, m] + back[k, 0, m]) / SPEED_OF_LIGHT
        d1 = (there[s, 1, m] + back[k, 1, m]) / SPEED_OF_LIGHT
        d2 = (there[s, 2, m] + back[k, 2, m]) / SPEED_OF_LIGHT
        # Whole cycles off before any sum: 26,000 of them at 50 m.
        cycles = start_frequency_hz * delay_s
        cycles -= np.floor(cycles)
        received_hz = start_frequency_hz + slope_hz_per_s * (on_ramp_s - delay_s)
        echo[0, m] = cycles + slope_hz_per_s * delay_s * (on_ramp_s - delay_s / 2)
        echo[1, m] = received_hz * d1 + swept_hz * delay_s
        echo[2, m] = received_hz * d2 + swept_hz * d1 - slope_hz_per_s / 2 * d1 * d1
        echo[3, m] = -there[s, 4, m] - back[k, 4, m]
        echo[4, m] = -there[s, 5, m] - back[k, 5, m]
        echo[5, m] = there[s, 3, m] * back[k, 3, m]


@_compiled
def _spreads(
    n: int,
    there: np.ndarray,
    back: np.ndarray,
    law: tuple[float, float, float, float],
    echo: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> tuple[float, float, float]:
    """Least and largest c1 of each chirp into `low` and `high`; |e1|, |g2| and the middle of c2."""
    low[:n] = np.inf
    high[:n] = -np.inf
    e1, e2, low2, high2 = 0.0, 0.0, np.inf, -np.inf
    for k in range(len(back)):
        for s in range(len(there)):
            _phases(n, there, s, back, k, law, echo)
            for m in range(n):
                low[m] = min(low[m], echo[1, m])
                high[m] = max(high[m], echo[1, m])
            for m in range(n):
                low2, high2 = min(low2, echo[2, m]), max(high2, echo[2, m])
                e1, e2 = max(e1, abs(echo[3, m])), max(e2, abs(echo[4, m]))
    return e1, e2 + np.pi * (high2 - low2), (low2 + high2) / 2


@_compiled
def _levels(
    low: np.ndarray,
    high: np.ndarray,
    shape: tuple[int, int, int],
    e1: float,
    g2: float,
    rest: float,
    tolerance: float,
    n_terms: np.ndarray,
    costs: np.ndarray,
) -> None:
    """Terms needed, and ns, for a single block, for two, four ... of them."""
    n_chirps, n_rx, n_samples = shape
    needed = _MOST + 1
    for level in range(len(costs)):
        length = -(-n_chirps // (1 << level))
        if needed > 2:
            half = 0.0
            for start in range(0, n_chirps, length):
                least, largest = np.inf, -np.inf
                for m in range(start, min(start + length, n_chirps)):
                    least, largest = min(least, low[m]), max(largest, high[m])
                half = max(half, (largest - least) / 2)
            needed = _needed(e1 + 2 * np.pi * half, g2, tolerance / 2)
        n_blocks = -(-n_chirps // length)
        n_terms[level] = needed
        costs[level] = np.inf
        if needed <= _MOST and rest <= tolerance / 4:
            table_ns = n_blocks * (_TABLE_NS + needed * _ENTRY_NS)
            costs[level] = _whole_tiles(n_samples) * (
                needed * n_chirps * n_rx * _TERM_NS + table_ns
            )


@_compiled
def _needed(g1: float, g2: float, tolerance: float) -> int:
    """Terms, at least 2, for exp(g1 r + g2 r^2), sizes given; _MOST + 1 if more than that."""
    # Taylor series; what is beyond it is below twice its first term.
    g1 = min(g1, 4.0)
    series = np.empty(_ORDERS + 1)
    series[0], series[1] = 1.0, g1
    for q in range(2, _ORDERS + 1):
        series[q] = (g1 * series[q - 1] + 2 * g2 * series[q - 2]) / q
    for n_terms in range(2, _MOST + 1):
        orders = min(n_terms + 2, _ORDERS)
        error = 2 * series[orders]
        for q in range(n_terms, orders):
            error += _DROPPED[n_terms, q] * series[q]
        if error <= tolerance:
            return n_terms
    return _MOST + 1


@_compiled
def _middles(low: np.ndarray, high: np.ndarray, n_chirps: int, length: int) -> None:
    """Put the middle of c1 of each block into `low` of its chirps."""
    for start in range(0, n_chirps, length):
        stop = min(start + length, n_chirps)
        least, largest = np.inf, -np.inf
        for m in range(start, stop):
            least, largest = min(least, low[m]), max(largest, high[m])
        for m in range(start, stop):
            low[m] = (least + largest) / 2


@_compiled
def _polynomials(
    n: int,
    echo: np.ndarray,
    middles: np.ndarray,
    bend: float,
    n_terms: int,
    powers: np.ndarray,
    coefficients: np.ndarray,
    first_term: int,
    n_rx: int,
    k: int,
    fresh: bool,
) -> None:
    """Add one transmitter's share to the coefficients of the echo in each chirp on receiver k."""
    for m in range(n):
        real, imag = cosine_and_sine(echo[0, m])
        powers[0, 0, m] = real * echo[5, m] - imag * echo[6, m]
        powers[0, 1, m] = real * echo[6, m] + imag * echo[5, m]
        echo[1, m] = 2 * np.pi * (echo[1, m] - middles[m])
        echo[2, m] = 4 * np.pi * (echo[2, m] - bend)
        echo[4, m] *= 2
    orders = min(n_terms + 2, _ORDERS)
    for q in range(1, orders):
        share = 1 / q
        for m in range(n):
            e1, c1 = echo[3, m], echo[1, m]
            real = powers[q - 1, 0, m] * e1 - powers[q - 1, 1, m] * c1
            imag = powers[q - 1, 1, m] * e1 + powers[q - 1, 0, m] * c1
            powers[q, 0, m] = share * real
            powers[q, 1, m] = share * imag
        if q > 1:
            for m in range(n):
                e2, c2 = share * echo[4, m], share * echo[2, m]
                real = powers[q - 2, 0, m] * e2 - powers[q - 2, 1, m] * c2
                imag = powers[q - 2, 1, m] * e2 + powers[q - 2, 0, m] * c2
                powers[q, 0, m] += real
                powers[q, 1, m] += imag
    for term in range(n_terms):
        for part in range(2):
            row = np.uint64((((first_term + term) * 2 + part) * n_rx + k) * (_LANES + 1))
            if fresh:
                for m in range(np.uint64(n)):
                    coefficients[row + m] = 0
            for q in range(term, orders):
                kept = _KEPT[n_terms, term, q]
                if kept != 0:
                    for m in range(np.uint64(n)):
                        coefficients[row + m] += kept * powers[q, part, m]


@_compiled
def _table(c1: float, c2: float, n: int, n_terms: int, tables: np.ndarray, term: int) -> None:
    """Fill rows of `tables`: real and imaginary part of B(r), then of B(r) r ..."""
    stride = _whole_tiles(n)
    step, half = 2 / n, (n - 1) / n
    pitch = np.uint64(stride)
    real = np.uint64(2 * term * stride)
    imag = real + pitch
    for x in range(pitch):
        r = step * x - half
        cosine, sine = cosine_and_sine(r * (c1 + r * c2))
        tables[real + x] = cosine
        tables[imag + x] = sine
    for k in range(1, n_terms):
        last_real = np.uint64(2 * (term + k - 1) * stride)
        last_imag = last_real + pitch
        real = last_imag + pitch
        imag = real + pitch
        for x in range(pitch):
            r = step * x - half
            tables[real + x] = r * tables[last_real + x]
            tables[imag + x] = r * tables[last_imag + x]


@_compiled
def _multiply(
    out: np.ndarray,
    start: int,
    stop: int,
    tables: np.ndarray,
    n_terms: int,
    coefficients: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Add the product of coefficients and tables to some chirps of `out`."""
    _, n_rx, n_samples = out.shape
    pitch, stride = n_rx * (_LANES + 1), _whole_tiles(n_samples)
    for k in range(n_rx):
        for m0 in range(start, stop, _ROWS):
            m1 = min(m0 + _ROWS, stop)
            for x0 in range(0, n_samples, _TILE):
                for x in range(np.uint64(2 * _TILE * (m1 - m0 + (m1 - m0) % 2))):
                    sums[x] = 0
                term = 0
                while term < n_terms:
                    at = 2 * term * stride + x0
                    here = 2 * term * pitch + k * (_LANES + 1)
                    odd = (n_terms - term) % 2 == 1
                    for m in range(m0, m1, 2):
                        row = 2 * (m - m0) * _TILE
                        if odd:
                            _add_three(sums, row, tables, at, stride, coefficients, here + m, pitch)
                        else:
                            _add_two(sums, row, tables, at, stride, coefficients, here + m, pitch)
                    term += 3 if odd else 2
                n, first = np.uint64(min(_TILE, n_samples - x0)), np.uint64(x0)
                for m in range(m0, m1):
                    chirp, antenna = np.uint64(m), np.uint64(k)
                    real = np.uint64(2 * (m - m0) * _TILE)
                    imag = real + _1
                    for x in range(n):
                        out[chirp, antenna, first + x] += complex(sums[real + x], sums[imag + x])


_1, _2, _3 = (np.uint64(i * _TILE) for i in range(1, 4))


@_compiled
def _add_three(
    sums: np.ndarray,
    row: int,
    tables: np.ndarray,
    at: int,
    stride: int,
    coefficients: np.ndarray,
    here: int,
    pitch: int,
) -> None:
    """Add three terms to a tile of two chirps: each table that is loaded is used twice."""
    a0, b0 = coefficients[here], coefficients[here + pitch]
    a1, b1 = coefficients[here + 2 * pitch], coefficients[here + 3 * pitch]
    a2, b2 = coefficients[here + 4 * pitch], coefficients[here + 5 * pitch]
    here += 1
    c0, d0 = coefficients[here], coefficients[here + pitch]
    c1, d1 = coefficients[here + 2 * pitch], coefficients[here + 3 * pitch]
    c2, d2 = coefficients[here + 4 * pitch], coefficients[here + 5 * pitch]
    p, s = np.uint64(row), np.uint64(stride)
    q0 = np.uint64(at)
    q1 = q0 + s
    q2 = q1 + s
    q3 = q2 + s
    q4 = q3 + s
    q5 = q4 + s
    for x in range(np.uint64(_TILE)):
        t0, u0 = tables[q0 + x], tables[q1 + x]
        t1, u1 = tables[q2 + x], tables[q3 + x]
        t2, u2 = tables[q4 + x], tables[q5 + x]
        sums[p + x] += a0 * t0 - b0 * u0 + a1 * t1 - b1 * u1 + a2 * t2 - b2 * u2
        sums[p + _1 + x] += a0 * u0 + b0 * t0 + a1 * u1 + b1 * t1 + a2 * u2 + b2 * t2
        sums[p + _2 + x] += c0 * t0 - d0 * u0 + c1 * t1 - d1 * u1 + c2 * t2 - d2 * u2
        sums[p + _3 + x] += c0 * u0 + d0 * t0 + c1 * u1 + d1 * t1 + c2 * u2 + d2 * t2


@_compiled
def _add_two(
    sums: np.ndarray,
    row: int,
    tables: np.ndarray,
    at: int,
    stride: int,
    coefficients: np.ndarray,
    here: int,
    pitch: int,
) -> None:
    a0, b0 = coefficients[here], coefficients[here + pitch]
    a1, b1 = coefficients[here + 2 * pitch], coefficients[here + 3 * pitch]
    here += 1
    c0, d0 = coefficients[here], coefficients[here + pitch]
    c1, d1 = coefficients[here + 2 * pitch], coefficients[here + 3 * pitch]
    p, s = np.uint64(row), np.uint64(stride)
    q0 = np.uint64(at)
    q1 = q0 + s
    q2 = q1 + s
    q3 = q2 + s
    for x in range(np.uint64(_TILE)):
        t0, u0 = tables[q0 + x], tables[q1 + x]
        t1, u1 = tables[q2 + x], tables[q3 + x]
        sums[p + x] += a0 * t0 - b0 * u0 + a1 * t1 - b1 * u1
        sums[p + _1 + x] += a0 * u0 + b0 * t0 + a1 * u1 + b1 * t1
        sums[p + _2 + x] += c0 * t0 - d0 * u0 + c1 * t1 - d1 * u1
        sums[p + _3 + x] += c0 * u0 + d0 * t0 + c1 * u1 + d1 * t1
