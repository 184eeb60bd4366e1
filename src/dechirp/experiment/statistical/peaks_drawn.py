"""Peaks of maps that are never made: the cells about each scatterer, drawn with their noise.

About every scatterer the cells that its peak may be in hold what all scatterers near it add up to,
and noise with the covariance of the transforms; so do the sums from which its frequencies and
amplitudes are estimated, see `axis_law`. The highest of these cells is a peak where none beside it
is higher, and a detection where it exceeds a threshold that is drawn from the law of its ring,
raised by what other targets leave in the ring. False alarms are cells whose noise is drawn over the
threshold; those that a neighbour exceeds are no peaks, as in a map. Sidelobes are screened as
`process.peaks` does.
"""

from typing import NamedTuple

import numba
import numpy as np

from dechirp.experiment.statistical.axis_law import FINE, NEAR, OFFSETS, SUMS, AxisLaw, Energy

# A cell of noise lies this many noise powers above nothing, in the mean.
_NOISE = 1.0
# A weaker echo beside a cell of noise leaves the cell a false alarm; a stronger one is a target.
_IS_TARGET = 0.5
# Unpadded bins on both axes within which two tones have one peak.
_IN_CELL = 0.75
# So far over its threshold a cell needs no noise of its own: estimates do.
_SURE = 10.0
# Unpadded bins within which tones add to each other's cells as amplitudes.
_SUMMED = 4.0


class Rings(NamedTuple):
    """What the detector takes of rings: their law, and where they lie."""

    statistic: np.ndarray
    """(n_draws,), this and the next two as in `ring_law.RingLaw`."""
    corners: np.ndarray
    sensitivity: float
    factors: np.ndarray
    """(n_rows,), threshold over statistic; infinite where nothing is searched."""
    n_training: np.ndarray
    """(n_rows,) cells in the ring."""
    shifts: np.ndarray
    """(n_rows,): by how much the middle of the box is from the row under test."""
    box: tuple[Energy, Energy]
    """Of velocity and range."""
    guard: tuple[Energy, Energy]
    sidelobes: tuple[np.ndarray, np.ndarray]
    """`process.peaks.sidelobe_amplitude` of both axes."""


class Alarms(NamedTuple):
    """Cells of noise over threshold, frame by frame."""

    first: np.ndarray
    """(n_frames + 1,): where those of each frame begin."""
    cells: np.ndarray
    """(n, 2), velocity and range."""
    power: np.ndarray
    """(n,), over the mean of noise."""
    ring: np.ndarray
    """(n,): which of the draws of the ring."""


class Drawn(NamedTuple):
    """Peaks of all frames, (n,), strongest first in each; noise powers are 1."""

    frame: np.ndarray
    """Number of each, from the first frame of the block."""
    slow: np.ndarray
    """Radians per chirp, from the first bin."""
    fast: np.ndarray
    """Radians per sample."""
    noise: np.ndarray
    """As measured: its mean is 1."""
    amplitude: np.ndarray
    """(n, n_channels) complex64: |.|^2 is a ratio."""


class Echoes(NamedTuple):
    """Of each frame and scatterer, (n_frames, n_scatterers): see `arrivals.Arrivals`."""

    velocity: np.ndarray
    row: np.ndarray
    amplitude: np.ndarray
    """(..., n_channels) complex64, as drawn for each frame."""
    in_cells: np.ndarray
    powers: np.ndarray
    """In the cell of each, mean over channels, over that of noise."""
    can: np.ndarray
    """bool: whether it is strong enough for a peak of its own."""


def numbers_needed(axes: tuple[AxisLaw, AxisLaw], n_channels: int) -> int:
    """Normal numbers that one candidate takes, at most."""
    over_velocity, over_range = (one.factors.shape[1] for one in axes)
    return 2 * n_channels * over_velocity * over_range


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _apart(a: float, b: float, n: float) -> float:
    """From b to a the short way round n bins."""
    away = a - b
    if away > n / 2:
        away -= n
    elif away < -n / 2:
        away += n
    return away


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _lobe(axis: AxisLaw, away: float) -> complex:
    place = (away + axis.reach) * ((axis.lobe.size - 1) / (2 * axis.reach)) if axis.reach else 0.0
    if place < 0 or place > axis.lobe.size - 1:
        return 0j
    low = min(int(place), max(axis.lobe.size - 2, 0))
    if axis.lobe.size == 1:
        return axis.lobe[0]
    part = place - low
    return axis.lobe[low] * (1 - part) + axis.lobe[low + 1] * part


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _moment(axis: AxisLaw, order: int, away: float) -> float:
    place = (away + NEAR) * FINE
    low = min(max(int(place), 0), axis.moments.shape[1] - 2)
    part = place - low
    return axis.moments[order, low] * (1 - part) + axis.moments[order, low + 1] * part


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _energy(of: Energy, away: float) -> float:
    if of.table.size == 1:
        return of.table[0]
    place = (away + of.reach) * ((of.table.size - 1) / (2 * of.reach))
    if place < 0 or place > of.table.size - 1:
        return 0.0
    return of.table[int(place + 0.5)]


class Work(NamedTuple):
    """Room for one candidate after the other."""

    cells: np.ndarray
    """Signals in the cells that its peak may be in, and one more on each side: real and imaginary
    parts, (2, n_velocity, n_range, n_channels) float32."""
    still: np.ndarray
    """Their powers, mean over channels."""
    sums: np.ndarray
    """(6, n_channels): of 1, p, q, pp, pq and qq, each normalised, p over chirps."""
    in_noise: np.ndarray
    """(n_channels, n_velocity, n_range): noise in the cells that its peak may be in."""
    power: np.ndarray
    """Of both together."""


_FAST = {"contract", "reassoc"}


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
def draw_peaks(
    echoes: Echoes,
    over_velocity: AxisLaw,
    over_range: AxisLaw,
    rings: Rings,
    alarms: Alarms,
    searched: np.ndarray,
    ring_of: np.ndarray,
    white: np.ndarray,
) -> Drawn:
    """Peaks of a block of frames.

    Parameters
    ----------
    echoes, over_velocity, over_range, rings, alarms
        What is sent back, and what is known of the axes, the rings and the cells of noise over
        threshold.
    searched : bool array (n_velocity, n_rows)
        Cells in which a peak may be.
    ring_of : array (n_candidates,)
        Which draw of the ring each candidate takes.
    white : float32 array (n_candidates + n_alarms, n)
        Normal numbers of each.
    """
    n_frames, n_scatterers, n_channels = echoes.amplitude.shape
    size_v, size_r = 2 * over_velocity.half + 1, 2 * over_range.half + 1
    n_most = len(ring_of) + len(alarms.ring)
    out_frame, out = np.empty(n_most, np.int64), np.empty((n_most, 5))
    out_cell = np.empty((n_most, 2), np.int64)
    out_amplitude = np.empty((n_most, n_channels), np.complex64)
    work = Work(
        np.empty((2, size_v + 2, size_r + 2, n_channels), np.float32),
        np.empty((size_v + 2, size_r + 2)),
        np.empty((6, n_channels), np.complex128),
        np.empty((n_channels, size_v, size_r), np.complex128),
        np.empty((size_v, size_r)),
    )
    n_out, n_own = 0, 0
    for f in range(n_frames):
        first_out = n_out
        for c in range(n_scatterers):
            if not echoes.can[f, c]:
                continue
            n_own += 1
            if _is_beside_stronger(echoes, f, c, over_velocity, over_range):
                continue
            at = echoes.velocity[f, c], echoes.row[f, c]
            n_out += _is_found(
                echoes, f, at, 0.0, ring_of[n_own - 1], white[n_own - 1], over_velocity, over_range,
                rings, searched, work, out[n_out], out_cell[n_out], out_amplitude[n_out],
            )  # fmt: skip
        for c in range(alarms.first[f], alarms.first[f + 1]):
            at = float(alarms.cells[c, 0]), float(alarms.cells[c, 1])
            n_out += _is_found(
                echoes, f, at, alarms.power[c], alarms.ring[c], white[len(ring_of) + c],
                over_velocity, over_range, rings, searched, work, out[n_out], out_cell[n_out],
                out_amplitude[n_out],
            )  # fmt: skip
        own = slice(first_out, n_out)
        kept = first_out + _clear(
            out[own, 3], out[own, 4], out_cell[own], rings, over_velocity.n_bins, over_range.n_bins
        )
        n_out = first_out + len(kept)
        out_frame[first_out:n_out] = f
        out[first_out:n_out] = out[kept]
        out_amplitude[first_out:n_out] = out_amplitude[kept]
    return Drawn(
        out_frame[:n_out],
        out[:n_out, 0].copy(),
        out[:n_out, 1].copy(),
        out[:n_out, 2].copy(),
        out_amplitude[:n_out],
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _is_beside_stronger(
    echoes: Echoes, f: int, c: int, over_velocity: AxisLaw, over_range: AxisLaw
) -> bool:
    """Whether a stronger scatterer is in the cell of one: of both there is one peak."""
    for j in range(echoes.powers.shape[1]):
        away_v = _apart(echoes.velocity[f, j], echoes.velocity[f, c], over_velocity.n_bins)
        away_r = _apart(echoes.row[f, j], echoes.row[f, c], over_range.n_bins)
        if (
            abs(away_v) * over_velocity.per_point < _IN_CELL
            and abs(away_r) * over_range.per_point < _IN_CELL
        ):
            more = echoes.powers[f, j] - echoes.powers[f, c]
            if more > 0 or (more == 0 and j < c):
                return True
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
def _is_found(
    echoes: Echoes,
    f: int,
    at: tuple[float, float],
    alarm: float,
    of_ring: int,
    numbers: np.ndarray,
    over_velocity: AxisLaw,
    over_range: AxisLaw,
    rings: Rings,
    searched: np.ndarray,
    work: Work,
    out: np.ndarray,
    out_cell: np.ndarray,
    out_amplitude: np.ndarray,
) -> bool:
    """Whether there is a detection about a place in a frame; fills its rows.

    `alarm`: the power of a cell of noise over threshold; 0 about a scatterer. `out`: frequencies
    of both axes, measured noise, amplitudes of the peak in the map and of its threshold.
    """
    half_v, half_r = over_velocity.half, over_range.half
    cell_v, cell_r = int(np.floor(at[0] + 0.5)), int(np.floor(at[1] + 0.5))
    in_ring = _echoes_about(echoes, f, at, over_velocity, over_range, rings, work.cells, work.sums)
    still, power = work.still, work.power
    _powers(work.cells, still)
    if alarm and still[half_v + 1, half_r + 1] > _IS_TARGET:
        return False
    row_of = min(max(cell_r, 0), rings.factors.size - 1)
    power[:] = still[1:-1, 1:-1] + _NOISE
    if not alarm and np.max(power) > _SURE * rings.factors[row_of]:
        _noise_of_sums(numbers, work.sums)
    else:
        table_v = over_velocity.factors[int((at[0] - cell_v + 0.5) * OFFSETS + 0.5)]
        table_r = over_range.factors[int((at[1] - cell_r + 0.5) * OFFSETS + 0.5)]
        _noise(numbers, table_v, table_r, work.sums, work.in_noise)
        if alarm:
            _raise(alarm, over_velocity.own, over_range.own, work.sums, work.in_noise)
        _powers_in(work.cells, work.in_noise, power)
    top_v, top_r = divmod(np.argmax(power), power.shape[1])
    top = power[top_v, top_r]
    if (alarm and (top_v != half_v or top_r != half_r)) or _is_under(top, still, top_v, top_r):
        return False
    peak_v = (cell_v + top_v - half_v) % over_velocity.n_bins
    # Rows of complex samples wrap round, as frequencies do.
    peak_r = (cell_r + top_r - half_r) % over_range.n_bins
    if peak_r >= rings.factors.size or not searched[peak_v, peak_r]:
        return False
    level = rings.statistic[of_ring] + rings.sensitivity * in_ring / rings.n_training[row_of]
    threshold = rings.factors[peak_r] * level
    if not top > threshold:
        return False
    step_v, step_r = _refined(work.sums, over_velocity.n_bins == 1, out_amplitude)
    out[0] = 2 * np.pi * at[0] / over_velocity.n_bins + step_v / over_velocity.spread
    out[1] = 2 * np.pi * at[1] / over_range.n_bins + step_r / over_range.spread
    out[2] = rings.corners[of_ring]
    out[3], out[4] = np.sqrt(top), np.sqrt(threshold)
    out_cell[0], out_cell[1] = peak_v, peak_r
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
def _echoes_about(
    echoes: Echoes,
    f: int,
    at: tuple[float, float],
    over_velocity: AxisLaw,
    over_range: AxisLaw,
    rings: Rings,
    cells: np.ndarray,
    sums: np.ndarray,
) -> float:
    """Fill cells and sums with what scatterers give them; the power of all in the ring."""
    n_v, n_r = over_velocity.n_bins, over_range.n_bins
    cell_v, cell_r = np.floor(at[0] + 0.5), np.floor(at[1] + 0.5)
    row_of = min(max(int(cell_r), 0), rings.factors.size - 1)
    shift = rings.shifts[row_of]
    reach_v = min(_SUMMED / over_velocity.per_point, over_velocity.reach)
    reach_r = min(_SUMMED / over_range.per_point, over_range.reach)
    in_all = 1 / np.sqrt(over_velocity.loss * over_range.loss)
    _, n_rows, n_columns, n_channels = cells.shape
    lobes_v, lobes_r = np.empty(n_rows, np.complex128), np.empty(n_columns, np.complex128)
    amplitude = echoes.amplitude[f].view(np.float32)
    cells[:], sums[:] = 0, 0
    in_ring = 0.0
    for j in range(len(amplitude)):
        away_v = _apart(echoes.velocity[f, j], cell_v, n_v)
        away_r = _apart(echoes.row[f, j], cell_r, n_r)
        if abs(away_v) <= rings.box[0].reach and abs(away_r) <= rings.box[1].reach + abs(shift):
            whole = _energy(rings.box[0], away_v) * _energy(rings.box[1], away_r - shift)
            within = _energy(rings.guard[0], away_v) * _energy(rings.guard[1], away_r)
            in_ring += echoes.powers[f, j] * max(whole - within, 0.0)
        if abs(away_v) > reach_v or abs(away_r) > reach_r:
            continue
        for a in range(n_rows):
            lobes_v[a] = _lobe(over_velocity, away_v - (a - n_rows // 2))
        for b in range(n_columns):
            lobes_r[b] = _lobe(over_range, away_r - (b - n_columns // 2))
        for a in range(n_rows):
            for b in range(n_columns):
                both = echoes.in_cells[f, j] * in_all * lobes_v[a] * lobes_r[b]
                re, im = np.float32(both.real), np.float32(both.imag)
                for k in range(n_channels):
                    x, y = amplitude[j, 2 * k], amplitude[j, 2 * k + 1]
                    cells[0, a, b, k] += re * x - im * y
                    cells[1, a, b, k] += re * y + im * x
        near_v = (echoes.velocity[f, j] - at[0] + n_v / 2) % n_v - n_v / 2
        near_r = (echoes.row[f, j] - at[1] + n_r / 2) % n_r - n_r / 2
        near_v, near_r = near_v * over_velocity.per_point, near_r * over_range.per_point
        if abs(near_v) < NEAR and abs(near_r) < NEAR:
            v0, v1 = _moment(over_velocity, 0, near_v), _moment(over_velocity, 1, near_v)
            r0, r1 = _moment(over_range, 0, near_r), _moment(over_range, 1, near_r)
            v2, r2 = _moment(over_velocity, 2, near_v), _moment(over_range, 2, near_r)
            for k in range(n_channels):
                z = echoes.amplitude[f, j, k]
                sums[0, k] += z * (v0 * r0)
                sums[1, k] += z * (1j * v1 * r0)
                sums[2, k] += z * (1j * v0 * r1)
                sums[3, k] += z * (v2 * r0)
                sums[4, k] += z * (-v1 * r1)
                sums[5, k] += z * (v0 * r2)
    return in_ring


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
def _powers(cells: np.ndarray, still: np.ndarray) -> None:
    """Mean power over channels in each cell."""
    n_channels = cells.shape[3]
    for a in range(still.shape[0]):
        for b in range(still.shape[1]):
            total = 0.0
            for k in range(n_channels):
                total += cells[0, a, b, k] ** 2 + cells[1, a, b, k] ** 2
            still[a, b] = total / n_channels


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
def _powers_in(cells: np.ndarray, in_noise: np.ndarray, power: np.ndarray) -> None:
    """Mean power over channels in each cell, with its noise."""
    for a in range(power.shape[0]):
        for b in range(power.shape[1]):
            total = 0.0
            for k in range(len(in_noise)):
                z = in_noise[k, a, b]
                x, y = cells[0, a + 1, b + 1, k] + z.real, cells[1, a + 1, b + 1, k] + z.imag
                total += x * x + y * y
            power[a, b] = total / len(in_noise)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _noise_of_sums(numbers: np.ndarray, sums: np.ndarray) -> None:
    """Add noise to the sums alone; that of their second moments is left out."""
    half = np.sqrt(0.5)
    for k in range(sums.shape[1]):
        own = numbers[6 * k : 6 * k + 6] * half
        z = complex(own[0], own[1])
        sums[0, k] += z
        sums[3, k] += z
        sums[5, k] += z
        sums[1, k] += complex(own[2], own[3])
        sums[2, k] += complex(own[4], own[5])


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
def _noise(
    numbers: np.ndarray,
    table_v: np.ndarray,
    table_r: np.ndarray,
    sums: np.ndarray,
    in_noise: np.ndarray,
) -> None:
    """Draw the noise in cells, and add that of the sums to them."""
    n_v, n_r = len(table_v), len(table_r)
    white = numbers.view(np.complex64).reshape(sums.shape[1], n_v, n_r)
    half_way, noise = np.empty((n_v, n_r), np.complex128), np.empty((n_v, n_r), np.complex128)
    for k in range(sums.shape[1]):
        for m in range(n_v):
            for n in range(n_r):
                z = 0j
                for i in range(n + 1):
                    z += white[k, m, i] * table_r[n, i]
                half_way[m, n] = z * np.sqrt(0.5)
        for m in range(n_v):
            for n in range(n_r):
                z = 0j
                for i in range(m + 1):
                    z += table_v[m, i] * half_way[i, n]
                noise[m, n] = z
        in_noise[k] = noise[SUMS:, SUMS:]
        _add_sums(sums, k, noise)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_sums(sums: np.ndarray, k: int, noise: np.ndarray) -> None:
    sums[0, k] += noise[0, 0]
    sums[1, k] += noise[1, 0]
    sums[2, k] += noise[0, 1]
    sums[3, k] += noise[2, 0]
    sums[4, k] += noise[1, 1]
    sums[5, k] += noise[0, 2]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _raise(
    power: float, own_v: np.ndarray, own_r: np.ndarray, sums: np.ndarray, in_noise: np.ndarray
) -> None:
    """Raise the noise of the middle cell to a power, and with it what hangs together with it."""
    n_channels, size_v, size_r = in_noise.shape
    middle = in_noise[:, size_v // 2, size_r // 2].copy()
    drawn = np.sum(np.abs(middle) ** 2)
    raised = np.sqrt(n_channels * power / drawn) - 1
    along = np.outer(own_v, own_r)
    for k in range(n_channels):
        more = raised * middle[k] * along
        in_noise[k] += more[SUMS:, SUMS:]
        _add_sums(sums, k, more)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _is_under(top: float, still: np.ndarray, top_v: int, top_r: int) -> bool:
    """Whether a cell beside those that were drawn is higher: one of another target."""
    for a in range(top_v, top_v + 3):
        for b in range(top_r, top_r + 3):
            is_inside = 0 < a < still.shape[0] - 1 and 0 < b < still.shape[1] - 1
            if not is_inside and still[a, b] + _NOISE > top:
                return True
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _refined(sums: np.ndarray, has_one_chirp: bool, amplitude: np.ndarray) -> tuple[float, float]:
    """Offset of the highest point, in units of 1 / spread; fills the amplitudes there.

    A step of Newton's on the logarithm of the summed periodogram, as `process.refine` takes them.
    """
    up_v, up_r, vv, vr, rr, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(sums.shape[1]):
        own = np.conj(sums[0, k])
        total += abs(sums[0, k]) ** 2
        up_v += (own * sums[1, k]).imag
        up_r += (own * sums[2, k]).imag
        vv += abs(sums[1, k]) ** 2 - (own * sums[3, k]).real
        vr += (np.conj(sums[1, k]) * sums[2, k] - own * sums[4, k]).real
        rr += abs(sums[2, k]) ** 2 - (own * sums[5, k]).real
    vv -= 2 * up_v**2 / total
    vr -= 2 * up_v * up_r / total
    rr -= 2 * up_r**2 / total
    if has_one_chirp:
        vv = -1.0
    determinant = vv * rr - vr * vr
    step_v = -(rr * up_v - vr * up_r) / determinant
    step_r = -(vv * up_r - vr * up_v) / determinant
    # Half a bin is pi / N, and p / spread runs to the root of 3: 0.9.
    if not (vv < 0 and determinant > 0) or max(abs(step_v), abs(step_r)) > 0.9:
        step_v, step_r = up_v / total, up_r / total
        longest = max(abs(step_v), abs(step_r), 0.9) / 0.9
        step_v, step_r = step_v / longest, step_r / longest
    there = 0.0
    for k in range(sums.shape[1]):
        z = sums[0, k] - 1j * (step_v * sums[1, k] + step_r * sums[2, k])
        z -= (step_v**2 * sums[3, k] + step_r**2 * sums[5, k]) / 2 + step_v * step_r * sums[4, k]
        there += abs(z) ** 2
        amplitude[k] = z
    # The logarithm is a parabola farther than amplitudes are.
    amplitude *= np.sqrt(total * np.exp((up_v * step_v + up_r * step_r) / total) / there)
    return step_v, step_r


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _clear(
    peak: np.ndarray,
    threshold: np.ndarray,
    cell: np.ndarray,
    rings: Rings,
    n_v: int,
    n_r: int,
) -> np.ndarray:
    """Places of the peaks, strongest first, without those beside or under sidelobes of others."""
    kept = np.empty(len(peak), np.int64)
    n_kept = 0
    for i in np.argsort(-peak):
        keep = True
        for k in kept[:n_kept]:
            dv, dr = abs(cell[i, 0] - cell[k, 0]), abs(cell[i, 1] - cell[k, 1])
            dv, dr = min(dv, n_v - dv), min(dr, n_r - dr)
            lobe = peak[k] * rings.sidelobes[0][dv] * rings.sidelobes[1][dr]
            if (dv <= 1 and dr <= 1) or peak[i] < lobe + threshold[i]:
                keep = False
                break
        if keep:
            kept[n_kept] = i
            n_kept += 1
    return kept[:n_kept]
