"""Range-Doppler map of one channel: window, both transforms, order, power too, in two passes.

Over chirps sixteen samples at a time, over samples sixteen velocities at a time: work that stays
in L1, then in L2, and no pass for windows, shift or power alone. In single precision throughout,
right to 2e-7 of the strongest cell. The reference frame, 2200 x 128, takes 0.7 ms on one core
where SciPy's transforms, of four numbers at once, take 1.5.
"""

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np

from dechirp.core.scratch import lent
from dechirp.core.threads import in_threads, slices
from dechirp.process.butterflies import (
    POINT,
    WIDTH,
    add_powers,
    exchange,
    order_of,
    set_powers,
    stages_of,
    take,
    transform,
)

# Of fewer velocities most of a vector would be empty.
_FEWEST_VELOCITIES = 8
# Parts of a map that threads share.
_FEWEST_CELLS = 2**15


class Axis(NamedTuple):
    """One windowed transform."""

    weights: np.ndarray
    """(n_points,) float32."""
    n_bins: int


def can(n_velocity_bins: int, n_range_bins: int, n_samples: int) -> bool:
    """Whether `add_power` transforms so many bins: of small factors, and enough of them."""
    return (
        n_samples >= WIDTH
        and n_velocity_bins >= _FEWEST_VELOCITIES
        and stages_of(n_velocity_bins) is not None
        and stages_of(n_range_bins) is not None
    )


def add_power(
    out: np.ndarray,
    samples: np.ndarray,
    channel: int,
    slow: Axis,
    fast: Axis,
    share: float,
    *,
    is_first: bool,
    n_threads: int = 1,
) -> None:
    """Add a share of the power of each cell of one channel, in place.

    Parameters
    ----------
    out : array (velocity, range), float32
        Contiguous; velocities ascend, zero in row n // 2.
    samples : array (chirp, channel, sample), complex64
        Contiguous.
    channel : int
        Which is added.
    slow, fast
        The transforms over chirps and samples, see `can`.
    share : float
        What powers are multiplied by.
    is_first : bool
        Whether `out` holds nothing yet, whatever is in it: that saves two passes over it.
    n_threads : int
        That share the work; the map does not depend on it.
    """
    n_samples = samples.shape[2]
    over_fast = stages_of(fast.n_bins)
    assert over_fast is not None
    n_blocks = -(-slow.n_bins // WIDTH)
    between = _floats("between", n_blocks * fast.n_bins * POINT)
    ranges = _places(fast.n_bins)
    flat = out.reshape(-1, copy=False)
    n_parts = min(n_threads, max(out.size // _FEWEST_CELLS, 1))

    def over_chirps(columns: slice) -> None:
        _velocities(between, samples, channel, slow, fast, columns)

    def over_samples(blocks: slice) -> None:
        _over_samples(
            flat, between, slow.n_bins, fast.n_bins, n_samples, *over_fast, ranges,
            np.float32(share), is_first, blocks.start, blocks.stop,
        )  # fmt: skip

    in_threads(n_parts, over_chirps, slices(-(-n_samples // WIDTH), n_parts))
    in_threads(n_parts, over_samples, slices(n_blocks, n_parts))


def put_spectrum(
    out: np.ndarray, samples: np.ndarray, channel: int, slow: Axis, fast: Axis
) -> None:
    """Put the spectrum of one channel in its place, arguments as of `add_power`.

    `out` is (velocity, channel, 2, range) float32, contiguous: real parts, then imaginary ones.
    """
    n_samples = samples.shape[2]
    over_fast = stages_of(fast.n_bins)
    assert over_fast is not None
    between = _floats("between", -(-slow.n_bins // WIDTH) * fast.n_bins * POINT)
    _velocities(between, samples, channel, slow, fast, slice(0, -(-n_samples // WIDTH)))
    first, row = 2 * channel * fast.n_bins, 2 * out.shape[1] * fast.n_bins
    _ranges(
        out.reshape(-1, copy=False), first, row, between, slow.n_bins, fast.n_bins, n_samples,
        *over_fast, _places(fast.n_bins),
    )  # fmt: skip


def _velocities(
    between: np.ndarray,
    samples: np.ndarray,
    channel: int,
    slow: Axis,
    fast: Axis,
    columns: slice,
) -> None:
    """`_over_chirps` for some sixteens of samples of a channel."""
    _, n_channels, n_samples = samples.shape
    over_slow = stages_of(slow.n_bins)
    assert over_slow is not None
    _over_chirps(
        between, samples.reshape(-1).view(np.float32), 2 * channel * n_samples,
        2 * n_channels * n_samples, slow.weights, fast.weights, fast.n_bins, *over_slow,
        _shifted(slow.n_bins), columns.start, columns.stop,
        _floats("chirps", slow.n_bins * POINT),
    )  # fmt: skip


def _floats(name: str, size: int) -> np.ndarray:
    """Memory that is kept, from a multiple of 64 bytes on: across two lines takes twice."""
    kept = lent(f"map over {name}", (size // 2 + 8,)).view(np.float32)
    first = -(kept.ctypes.data // 4) % 16
    return kept[first : first + size]


@lru_cache(maxsize=32)
def _places(n_bins: int) -> np.ndarray:
    """Float at which each bin lies after the transform, to a multiple of sixteen bins."""
    return _in_floats(order_of(n_bins))


@lru_cache(maxsize=32)
def _shifted(n_bins: int) -> np.ndarray:
    """The same, negative frequencies first."""
    return _in_floats(np.fft.fftshift(order_of(n_bins)))


def _in_floats(points: np.ndarray) -> np.ndarray:
    found = np.pad(points * POINT, (0, -points.size % WIDTH))
    found.setflags(write=False)
    return found


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _over_chirps(
    between: np.ndarray,
    numbers: np.ndarray,
    first: int,
    row: int,
    slow: np.ndarray,
    fast: np.ndarray,
    n_range: int,
    radices: np.ndarray,
    twiddles: np.ndarray,
    places: np.ndarray,
    start: int,
    stop: int,
    work: np.ndarray,
) -> None:
    """From samples to velocities, for some sixteens of samples: (velocity / 16, sample, point)."""
    n_chirps, n_velocity = len(slow), len(work) // POINT
    n_blocks = (n_velocity + WIDTH - 1) // WIDTH
    for column in range(start, stop):
        # The last sixteen are whole, too: some are done twice, with the same result.
        sample = min(column * WIDTH, len(fast) - WIDTH)
        for m in range(n_chirps):
            take(work, m * POINT, numbers, first + m * row + 2 * sample, fast, sample, slow[m])
        work[n_chirps * POINT :] = 0
        transform(work, 0, n_velocity, radices, twiddles)
        for block in range(n_blocks):
            to = (block * n_range + sample) * POINT
            exchange(between, to, POINT, WIDTH, work, places, block * WIDTH)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _over_samples(
    out: np.ndarray,
    between: np.ndarray,
    n_velocity: int,
    n_range: int,
    n_samples: int,
    radices: np.ndarray,
    twiddles: np.ndarray,
    places: np.ndarray,
    share: np.float32,
    is_first: bool,
    start: int,
    stop: int,
) -> None:
    """From samples to ranges and their power, for some sixteens of velocities."""
    tile = np.empty(WIDTH * WIDTH, np.float32)
    for block in range(start, stop):
        work = between[block * n_range * POINT : (block + 1) * n_range * POINT]
        work[n_samples * POINT :] = 0
        transform(work, 0, n_range, radices, twiddles)
        velocity = block * WIDTH
        n_rows = min(WIDTH, n_velocity - velocity)
        for at in range(0, n_range, WIDTH):
            n_columns = min(WIDTH, n_range - at)
            here = velocity * n_range + at
            if n_rows == WIDTH and n_columns == WIDTH:
                if is_first:
                    set_powers(out, here, n_range, work, places, at, share)
                else:
                    add_powers(out, here, n_range, work, places, at, share)
                continue
            set_powers(tile, 0, WIDTH, work, places, at, share)
            for i in range(n_rows):
                for j in range(n_columns):
                    before = np.float32(0) if is_first else out[here + i * n_range + j]
                    out[here + i * n_range + j] = before + tile[i * WIDTH + j]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _ranges(
    out: np.ndarray,
    first: int,
    row: int,
    between: np.ndarray,
    n_velocity: int,
    n_range: int,
    n_samples: int,
    radices: np.ndarray,
    twiddles: np.ndarray,
    places: np.ndarray,
) -> None:
    """From samples to ranges, into rows of `out` that begin so many floats from each other."""
    tile = np.empty(WIDTH * POINT, np.float32)
    for velocity in range(0, n_velocity, WIDTH):
        work = between[velocity * n_range * 2 : (velocity + WIDTH) * n_range * 2]
        work[n_samples * POINT :] = 0
        transform(work, 0, n_range, radices, twiddles)
        n_rows = min(WIDTH, n_velocity - velocity)
        for at in range(0, n_range, WIDTH):
            n_columns = min(WIDTH, n_range - at)
            here = first + velocity * row + at
            if n_rows == WIDTH and n_columns == WIDTH:
                exchange(out, here, row, n_range, work, places, at)
                continue
            exchange(tile, 0, POINT, WIDTH, work, places, at)
            for i in range(n_rows):
                for j in range(n_columns):
                    out[here + i * row + j] = tile[i * POINT + j]
                    out[here + i * row + n_range + j] = tile[i * POINT + WIDTH + j]
