r"""How often a chain finds each target of a case, by theory.

A target is found where any cell of its main lobe exceeds the threshold, not only the one nearest
to it: the neighbours hold nearly as much of it where it lies between cells, and their noise is
not the same. The exact law of the nearest cell, `theory.cfar_detection`, gets what they add to it,

.. math:: P_d = P_d^1 + \mathrm{E}\left[G(\max_c p_c) - G(p_0)\right],

with p_c the powers of the cells within two resolution cells, jointly Gaussian amplitudes, p_0
that of the nearest cell, and G(p) the probability that the threshold lies below p. The mean is
over draws of a fixed seed, good to 0.002 for one channel. One threshold is taken for all these
cells, whose rings are nearly the same.

In the reference scene, whose target lies near a cell, the neighbours add 0.001; half a cell off
on both axes 0.27 where the nearest alone has 0.44 under Hann windows, and 0.45 under rectangular
ones. In 48 measurements with 64 x 32 samples (1,500 to 6,000 trials each: windows, padding, an
ordered statistic, four receivers, real samples, two kinds of fading, 12 to 24 dB, on and between
cells) the chain was within 0.02 of this law, and within two standard errors of that, 0.003 to
0.013; and up to 0.42 above the nearest cell alone.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.evaluate.detector import Detector, detector
from dechirp.evaluate.gates import reach, turns
from dechirp.evaluate.look import Case
from dechirp.process.cfar.base import Noise
from dechirp.process.chain import Chain
from dechirp.process.peaks import sidelobe_amplitude
from dechirp.process.spectrum import Transform, independent_rows
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place

# A case of many frames is told from so many of them, evenly spread; fewer of many targets, each of
# which is looked at beside each other.
_MOST_FRAMES, _MOST_LOOKS = 16, 200
# With as many draws the standard error of what neighbours add is 0.002; cells that are kept, 24
# MB, and drawn, in all channels.
_MOST_DRAWS, _CELLS_KEPT, _CELLS_DRAWN = 64_000, 2_000_000, 8_000_000
# No law holds where what others leak could move the probability by more.
_MOST_MOVED = 0.02
# A target that walks through more of a range cell within the frame is spread by it.
_MOST_WALK = 0.5
# Ratio of all channels together at which a target is found, but for deep fades.
_FOUND = 1e5
_SWERLING = {"steady": 0, "swerling-1": 1, "swerling-3": 3}
_FINE = 16  # parts of a bin in which a window's response is tabled


def detection_probabilities(case: Case) -> np.ndarray:
    """Probability that each target is found in a frame, the mean over frames, (n_targets,).

    NaN where no law holds: in scenes with bodies, and of targets that fluctuate from chirp to
    chirp; with samples cleaned, triangles, or other noise than white; for detectors without a
    closed law, see `detector.detector`; where a target walks through half a range cell or lies
    in rows that are not searched; and where others might move its probability by 0.02 by their
    sidelobes, in its cells, in its training ring or as the envelope that it must stand out from.
    """
    n_frames = min(_MOST_FRAMES, max(_MOST_LOOKS // max(len(case.names), 1), 1))
    frames = np.linspace(0, case.truth.sizes["frame"] - 1, n_frames)
    frames = np.unique(frames.round().astype(int))
    known = case.truth.isel(frame=frames)
    if not _has_law(case):
        return np.full(known.sizes["target"], np.nan)
    of_frames = [
        _in_frame(case, known.isel(frame=place), slice(place, None, len(frames)))
        for place in range(len(frames))
    ]
    return np.asarray(np.mean(of_frames, axis=0))


def kept_in_cell(
    place: Place, radar: Radar, over_range: Transform, over_velocity: Transform
) -> np.ndarray:
    """What the nearest cell of a map keeps of the ratio after integration; any shape.

    All channels together: losses of both windows, and of lying between cells.
    """
    losses = over_range.noise_bandwidth_bins * over_velocity.noise_bandwidth_bins
    fast, slow = turns(place, radar)
    straddles = [
        over_range.straddle(one) * over_velocity.straddle(other)
        for one, other in zip(fast.flat, slow.flat, strict=True)
    ]
    return np.reshape(straddles, fast.shape) / losses


def _has_law(case: Case) -> bool:
    return (
        "snr" in case.truth
        and np.isfinite(case.noise_power_w)
        and case.noise_power_w > 0
        and not case.chain.mitigation
        and not case.radar.frame.falls
        and all(target.body is None for target in case.scene.targets)
        and detector(case.chain.cfar, case.chain.noise(case.radar)) is not None
    )


class _Echo(NamedTuple):
    """A target in the map of one frame."""

    row: float
    """Along range, in bins, and along velocity."""
    column: float
    total: float
    """Ratio on a bin after both windows, of all channels together."""
    swerling: int | None
    """None: no law."""


def _in_frame(case: Case, known: xr.Dataset, draws: slice) -> np.ndarray:
    """Probabilities of all targets in one frame of the truth, (n_targets,).

    Each frame has draws of its own: together they are as good as those of one.
    """
    radar = case.radar.at(int(known.frame))
    noise = case.chain.noise(radar)
    place = Place(known.range.values, known.velocity.values)
    fast, slow = turns(place, radar)
    losses = noise.over_range.noise_bandwidth_bins * noise.over_velocity.noise_bandwidth_bins
    walk = abs(place.velocity_m_per_s) * radar.frame.duration_s
    walks = walk > _MOST_WALK * radar.frame.chirp.range_resolution_m
    echoes = [
        _Echo(
            float(fast[at] * noise.over_range.n_bins),
            float(slow[at] * noise.over_velocity.n_bins),
            float(known.snr.values[at] / losses),
            _SWERLING.get(target.fluctuation),
        )
        for at, target in enumerate(case.scene.targets)
    ]
    found = np.full(len(echoes), np.nan)
    for at, echo in enumerate(echoes):
        others = echoes[:at] + echoes[at + 1 :]
        if echo.swerling is not None and not (walks[at] and case.chain.range_walk is None):
            found[at] = _probability(echo, others, case.chain, radar, noise, draws)
    return found


def _probability(
    echo: _Echo, others: list[_Echo], chain: Chain, radar: Radar, noise: Noise, draws: slice
) -> float:
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    row = round(echo.row) % noise.over_range.n_bins
    if not rows.start <= row < rows.stop:
        return np.nan
    place = int(chain.cfar.ring.places(rows.stop - rows.start)[row - rows.start])
    law = detector(chain.cfar, noise, place)
    assert law is not None and echo.swerling is not None
    if not _is_alone(echo, others, law, chain.cfar.ring.offsets(place), noise):
        return np.nan
    straddle = _straddle(echo, noise)
    alone = _law(law, echo.total * straddle / noise.n_channels, echo.swerling)
    return float(np.clip(alone + _from_neighbours(echo, law, noise, draws), 0.0, 1.0))


def _law(law: Detector, snr: float, swerling: int) -> float:
    """Of the nearest cell. Its sums grow with the ratio, and above 50 dB it is found."""
    snr = min(snr, _FOUND / law.n_summed)
    return float(law.probability(np.array(snr), swerling=swerling))


def _straddle(echo: _Echo, noise: Noise) -> float:
    return float(
        _tabled(noise.over_range, np.array(echo.row - round(echo.row))) ** 2
        * _tabled(noise.over_velocity, np.array(echo.column - round(echo.column))) ** 2
    )


def _is_alone(
    echo: _Echo, others: list[_Echo], law: Detector, offsets: np.ndarray, noise: Noise
) -> bool:
    """Whether sidelobes, its own in its ring and those of others, move its probability little.

    Those of others in its cell may add to its amplitude or take off; in its ring they raise the
    threshold; and a weaker peak must exceed it by the envelope of a stronger one's.
    """
    over_range, over_velocity = noise.over_range, noise.over_velocity
    row, column = round(echo.row), round(echo.column)
    in_cell = in_ring = envelope = 0.0
    for other in (echo, *others):
        dr, dv = row - other.row, column - other.column
        lobes = _tabled(over_range, dr + offsets[:, 1]) * _tabled(over_velocity, dv + offsets[:, 0])
        in_ring += other.total / noise.n_channels * float(np.mean(lobes**2))
        if other is echo:
            continue
        lobe = _tabled(over_range, np.array(dr)) * _tabled(over_velocity, np.array(dv))
        in_cell += np.sqrt(other.total / noise.n_channels) * float(lobe)
        if other.total >= echo.total:
            highest = _envelope(over_range, dr) * _envelope(over_velocity, dv)
            envelope += np.sqrt(other.total / noise.n_channels) * highest
    amplitude = np.sqrt(echo.total * _straddle(echo, noise) / noise.n_channels)
    raised = (np.sqrt(law.factor * (1 + in_ring)) + envelope) ** 2
    most = _law(law, (amplitude + in_cell) ** 2, echo.swerling or 0)
    least = _law(
        replace(law, factor=float(raised)),
        max(amplitude - in_cell, 0.0) ** 2,
        echo.swerling or 0,
    )
    return most - least <= _MOST_MOVED


def _from_neighbours(echo: _Echo, law: Detector, noise: Noise, draws: slice) -> float:
    """What the other cells of the main lobe add to the probability."""
    noises, rest = (each[draws] for each in _drawn(noise))
    lobe = np.multiply.outer(
        _lobe(noise.over_velocity, echo.column), _lobe(noise.over_range, echo.row)
    ).astype(np.complex64)
    shape = {0: None, 1: 1.0, 3: 2.0}[echo.swerling or 0]
    powers = np.full(len(noises), min(echo.total, _FOUND))
    if shape is not None:
        powers *= np.random.default_rng(2).standard_gamma(shape, len(noises)) / shape
    amplitudes = np.sqrt(powers).astype(np.float32)
    # Channels may be turned so that one has all of the echo.
    cells = abs(amplitudes[:, None, None] * lobe + noises) ** 2 + rest
    nearest = cells[:, lobe.shape[0] // 2, lobe.shape[1] // 2]
    highest = cells.max(axis=(1, 2))
    more = law.passes(highest / noise.n_channels) - law.passes(nearest / noise.n_channels)
    return float(np.mean(more))


def _lobe(transform: Transform, at: float) -> np.ndarray:
    """Response to a tone in the cells about the nearest one, (n_cells,) complex."""
    off = at - round(at) - np.arange(-reach(transform), reach(transform) + 1)
    turns = np.exp(2j * np.pi / transform.n_bins * np.outer(off, np.arange(transform.n_points)))
    return np.asarray(turns @ transform.weights / transform.weights.sum())


@lru_cache(maxsize=2)
def _drawn(noise: Noise) -> tuple[np.ndarray, np.ndarray]:
    """Noise in the cells about a target, of unit power, each (n_draws, velocity, range).

    Amplitudes of one channel, complex, and powers of all others together.
    """
    roots = [
        _root(along.covariance(2 * reach(along) + 1))
        for along in (noise.over_velocity, noise.over_range)
    ]
    shape = tuple(len(root) for root in roots)
    n_cells = shape[0] * shape[1]
    kept, drawn = _CELLS_KEPT // n_cells, _CELLS_DRAWN // (n_cells * noise.n_channels)
    n_draws = max(min(_MOST_DRAWS, kept, drawn), _MOST_FRAMES)
    rng = np.random.default_rng(1)

    def channel() -> np.ndarray:
        white = rng.standard_normal((n_draws, *shape, 2), np.float32).view(np.complex64)[..., 0]
        return np.asarray(roots[0] @ (white * np.float32(np.sqrt(0.5))) @ roots[1].T)

    first, rest = channel(), np.zeros((n_draws, *shape), np.float32)
    for _ in range(noise.n_channels - 1):
        rest += abs(channel()) ** 2
    return first, rest


def _root(covariance: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(covariance)  # padded bins are nearly dependent
    return np.asarray(vectors * np.sqrt(np.clip(values, 0, None)), np.complex64)


def _tabled(transform: Transform, apart: np.ndarray) -> np.ndarray:
    """Amplitude of a window's response so many bins from a tone, of that on it; any shape."""
    n = _FINE * transform.n_bins
    at = np.asarray(apart) % transform.n_bins * _FINE
    table, low = _response(transform), np.floor(at).astype(int)
    part = at - low
    return np.asarray((1 - part) * table[low % n] + part * table[(low + 1) % n])


@lru_cache(maxsize=16)
def _response(transform: Transform) -> np.ndarray:
    weights = transform.weights
    return abs(np.fft.fft(weights, _FINE * transform.n_bins)) / float(np.sum(weights))


def _envelope(transform: Transform, apart: float) -> float:
    bins = round(abs(apart)) % transform.n_bins
    return float(sidelobe_amplitude(transform)[min(bins, transform.n_bins - bins)])
