"""From the samples of a frame to its detections: the page that calls the rest."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import InvalidSetting
from dechirp.process.chain import Chain
from dechirp.process.estimates import estimates, noise_about, principal_hz
from dechirp.process.folds import intervals, ramps
from dechirp.process.folds.ambiguity import Folds, folds, responses, unknown
from dechirp.process.folds.pairing import Peaks, Unfolded, paired
from dechirp.process.interpolation import between_bins
from dechirp.process.maps import cells_over, level_of, power_of
from dechirp.process.mitigation.cleaned import Removed, cleaned
from dechirp.process.mitigation.noise import LEAST
from dechirp.process.range_walk import growth
from dechirp.process.refine import Tones, refine
from dechirp.process.sources import (
    Sources,
    aperture_of,
    from_origin,
    middle_m,
    sources,
    tells_directions,
    undirected,
)
from dechirp.process.spectrum import noise_gain
from dechirp.process.unit import exponent_of, in_unit
from dechirp.process.virtual import channels
from dechirp.radar.cube import must_be_sampled_as
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


def detect(cube: xr.DataArray, radar: Radar, chain: Chain | None = None) -> xr.Dataset:
    """Detections in each frame of a cube, simulated or recorded.

    Parameters
    ----------
    cube : DataArray (frame, chirp, rx, sample)
        complex for complex sampling, real for real, processed in single precision; any
        order of axes.
    radar : Radar
        The waveform and the receivers that the cube was taken with.
    chain : Chain, optional
        Windows, bins and detector; Hann windows and a 2-D cell-averaging CFAR at 1e-6
        without it. The default training cells become fewer where the map is small.

    Returns
    -------
    Dataset over `detection`
        frame
            Index of the frame in the cube.
        time : s
            Mid-frame, mid-window: the instant to which the estimates refer.
        range : m, velocity : m/s
            Range from the origin, or where no direction or fold is known from the middle of the
            array; velocity is the change of the range from that middle. Receding positive;
            refined on unwindowed samples, range-Doppler coupling removed; unfolded where `fold`
            is known, else of the fold about zero velocity. A frame of one chirp tells no
            velocity: NaN, and the range of a target at rest.
        snr : ratio
            After integration over all samples, chirps and channels, without the window's
            loss: what the standard errors rest on. Noise from the corners of the training
            ring, which the sidelobes of the target do not reach; a ring of few cells (2 x 2
            on each side) makes it half a dB too high in the mean.
        range_std : m, velocity_std : m/s
            Standard errors: the Cramer-Rao bound at that ratio, and for the noise of so many
            channels, whose powers are added, 1 + channels / snr times its variance.
        azimuth : rad, elevation : rad
            Of each source that the estimator finds in a detection, left and up positive: one
            row each, strongest first, the ratio shared out by power. NaN where not estimated.
            From the origin, where the fold is known, else from the middle of the array. A line
            tells the cone on which a target lies: its angle is that of a target on the level of
            the line (the other angle 0), and so is the way from the middle to the origin.
            They go with the velocity of their row: another fold would turn several
            transmitters against each other, and with them the angle.
        azimuth_std : rad, elevation_std : rad
            Standard errors, from the Cramer-Rao bound.
        fold, fold_confidence
            How many spans of unambiguous velocity were added, told from how the transmitters
            or the ramps turn against each other, from the beats of a triangle, or from frames
            of other intervals; NaN where that is ambiguous, the probability of the likeliest
            below 0.99. Both NaN for one transmitter with ramps and intervals that are alike.

    Raises
    ------
    InvalidSetting
        If the cube is not that radar's, holds samples that are not finite, or the training
        cells do not fit into the map.
    NotEnoughMemory
        If the map would not fit.

    Warns
    -----
    PhysicsWarning
        If a frame has more than 2,000 peaks: the strongest are kept.
    """
    return detect_each([cube], radar, chain)


def detect_each(
    cubes: Iterable[xr.DataArray],
    radar: Radar,
    chain: Chain | None = None,
    *,
    first: int = 0,
    took_out: Callable[[tuple[Removed, ...]], None] | None = None,
) -> xr.Dataset:
    """Detections in cubes of successive frames, as `detect`; `first`: the number of the first one.

    `took_out` is called with what clean-up took out of each frame, if there is any. A cube is
    asked for when the one before is done with. Of frames with intervals in turn, the amplitudes
    of all peaks are kept until the last: only then are folds, and directions, told.
    """
    return labelled_detections(
        detected_columns(cubes, radar, chain, first=first, took_out=took_out)
    )


def labelled_detections(columns: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Columns of `detected_columns` as a Dataset over `detection`, with units."""
    return xr.Dataset(
        {name: ("detection", columns[name], {"units": units}) for name, units in UNITS.items()}
    )


def detected_columns(
    cubes: Iterable[xr.DataArray],
    radar: Radar,
    chain: Chain | None = None,
    *,
    first: int = 0,
    took_out: Callable[[tuple[Removed, ...]], None] | None = None,
    maps: Callable[[np.ndarray], None] | None = None,
) -> dict[str, np.ndarray]:
    """Columns of `detect_each`, (n_detections,) each, without labels, which take 1 ms.

    `maps` is called with the power map of each frame as the detector sees it, (velocity, range)
    float32, see `process.maps.level_of`: once for the rising and once for the falling ramps of
    triangles. It may not keep the array unless it copies it.

    Raises and warns as `detect`.
    """
    chain = (chain or Chain()).fitted(radar)
    seen = (_seen(*frame, radar, chain, took_out, maps) for frame in _frames(cubes, radar, first))
    frames: Iterable[_Seen] = seen
    if radar.frame.n_intervals > 1 and radar.frame.n_chirps > 1:
        frames = list(seen)
        if len(frames) > 1:  # one by itself has told what it can
            frames = _agreed(frames, radar.frame)
    columns = [_columns(one, chain) for one in frames]
    if len(columns) == 1:
        return columns[0]
    return {name: np.concatenate([c[name] for c in columns]) for name in UNITS}


UNITS = {
    "frame": "1",
    "time": "s",
    "range": "m",
    "velocity": "m/s",
    "azimuth": "rad",
    "elevation": "rad",
    "snr": "1",
    "range_std": "m",
    "velocity_std": "m/s",
    "azimuth_std": "rad",
    "elevation_std": "rad",
    "fold": "1",
    "fold_confidence": "1",
}
"""Of the columns of detections, in order."""


class _Seen(NamedTuple):
    """Peaks of one frame, with their Doppler frequencies."""

    number: int
    time_s: float
    """Mid-frame."""
    radar: Radar
    """With the interval of the frame."""
    found: Unfolded


def _frames(
    cubes: Iterable[xr.DataArray], radar: Radar, first: int
) -> Iterator[tuple[int, float, np.ndarray]]:
    """Number, start in s and samples (chirp, rx, sample) of each frame of the cubes."""
    number = first
    for cube in cubes:
        _must_be_of(cube, radar)
        # Labels of a label take 0.03 ms.
        labels = cube.coords.variables
        starts_s = labels["frame"].values if "frame" in labels else None
        is_one = cube.dims == CUBE_AXES and len(cube) == 1
        for place in range(cube.sizes["frame"]):
            # One at a time: of a cube on disk no more is read.
            if is_one:
                samples = cube.variable.values[0]
            else:
                samples = cube.variable.isel(frame=place).transpose(*CUBE_AXES[1:]).values
            start_s = radar.frame.start_s(number) if starts_s is None else starts_s[place]
            yield number, float(start_s), samples
            number += 1


def _seen(
    number: int,
    start_s: float,
    samples: np.ndarray,
    radar: Radar,
    chain: Chain,
    took_out: Callable[[tuple[Removed, ...]], None] | None,
    maps: Callable[[np.ndarray], None] | None,
) -> _Seen:
    """What one frame alone tells, of its samples (chirp, rx, sample)."""
    radar = radar.at(number)
    frame = radar.frame
    kind = np.complex64 if frame.chirp.sampling == "complex" else np.float32
    sent = np.ascontiguousarray(samples, kind)
    if chain.mitigation:
        clean = cleaned(sent, frame, chain.mitigation)
        sent = clean.samples
        if took_out is not None:
            took_out(clean.removed)
    exponent = exponent_of(sent)
    samples = channels(in_unit(sent, exponent), frame)
    if maps is not None and exponent:
        maps = _in_their_unit(maps, exponent)
    if frame.falls:
        n_rx, one_sided = radar.array.n_rx, radar.one_sided()
        up, down = (
            _peaks(np.ascontiguousarray(samples[:, half]), one_sided, chain, maps)
            for half in (slice(n_rx), slice(n_rx, None))
        )
        found = paired(up, down, frame)
    else:
        found = _unfolded(_peaks(samples, radar, chain, maps), radar, chain)
    return _Seen(number, start_s + frame.mid_frame_s, radar, found)


def _in_their_unit(
    maps: Callable[[np.ndarray], None], exponent: int
) -> Callable[[np.ndarray], None]:
    """`maps` for power maps of samples over 2^exponent: it gets those of the samples."""
    return lambda power: maps(in_unit(power, -2 * exponent))


def _agreed(frames: list[_Seen], frame: Frame) -> Iterator[_Seen]:
    """The same with the folds that frames of intervals in turn tell together."""
    alone, principal = [], []
    for one in frames:
        own = one.radar.frame
        found = _of_fold(one.found, principal_hz(one.found.peaks.tones, own), own)
        tones = found.peaks.tones
        at = estimates(tones.fast, found.doppler_hz, found.peaks.snr, own, one.radar.n_summed)
        alone.append(
            intervals.Alone(
                number=one.number,
                time_s=one.time_s,
                range_m=at["range"],
                velocity_m_per_s=at["velocity"],
                range_std_m=at["range_std"],
                velocity_std_m_per_s=at["velocity_std"],
                folds=found.folds,
            )
        )
        principal.append(found)
    for one, found, told in zip(frames, principal, intervals.folds(alone, frame), strict=True):
        own = one.radar.frame
        doppler_hz = found.doppler_hz + np.nan_to_num(told.certain) / own.repetition_s
        yield one._replace(found=_of_fold(found, doppler_hz, own)._replace(folds=told))


def _of_fold(found: Unfolded, doppler_hz: np.ndarray, frame: Frame) -> Unfolded:
    """The same peaks at other Doppler frequencies: a triangle's beats tell the range in any."""
    peaks = found.peaks
    if frame.falls:
        turn = 2 * np.pi / frame.chirp.sample_rate_hz
        fast = peaks.tones.fast + turn * (doppler_hz - found.doppler_hz)
        peaks = peaks._replace(tones=replace(peaks.tones, fast=fast))
    return found._replace(peaks=peaks, doppler_hz=doppler_hz)


def _columns(seen: _Seen, chain: Chain) -> dict[str, np.ndarray]:
    """Columns of the detections in one frame, a row for each source."""
    found, radar = seen.found, _with_one_map(seen.radar)
    tones, doppler_hz, noise = found.peaks.tones, found.doppler_hz, found.peaks.amplitude_noise
    if chain.angle is None:
        told = undirected(len(doppler_hz))
    else:
        view = aperture_of(radar, chain.field_of_view)
        told = sources(tones.amplitude, doppler_hz, noise, radar, chain.angle, view)
    columns = {
        "frame": np.full(len(told.detection), seen.number),
        "time": np.full(len(told.detection), seen.time_s),
    }
    snr = found.peaks.snr
    return {**columns, **described(told, tones.fast, doppler_hz, snr, found.folds, seen.radar)}


def _with_one_map(radar: Radar) -> Radar:
    """The radar whose ramps peaks of both sides of triangles are told by."""
    return radar.one_sided() if radar.frame.falls else radar


def described(
    told: Sources,
    fast: np.ndarray,
    doppler_hz: np.ndarray,
    snr: np.ndarray,
    folds: Folds,
    radar: Radar,
) -> dict[str, np.ndarray]:
    """Columns of detections but for frame and time, a row for each source.

    `fast` in radians per sample, `doppler_hz`, `snr` and `folds` are those of the peaks that the
    sources are of.
    """
    of = told.detection
    columns = {
        **estimates(fast[of], doppler_hz[of], snr[of] * told.share, radar.frame, radar.n_summed),
        "azimuth": told.azimuth_rad,
        "elevation": told.elevation_rad,
        "azimuth_std": told.azimuth_std_rad,
        "elevation_std": told.elevation_std_rad,
        "fold": folds.certain[of],
        "fold_confidence": folds.confidence[of],
    }
    if radar.calibration is not None:
        columns["range"] -= radar.calibration.range_offset_m
    at = told.azimuth_rad, told.elevation_rad
    middle = middle_m(*at, columns["fold"], _with_one_map(radar))
    if middle.any():
        columns["range"], columns["azimuth"], columns["elevation"] = from_origin(
            columns["range"], *at, middle
        )
    return columns


def _peaks(
    samples: np.ndarray, radar: Radar, chain: Chain, maps: Callable[[np.ndarray], None] | None
) -> Peaks:
    """Peaks of the map of one frame, (chirp, channel, sample), refined on its samples."""
    frame, noise = radar.frame, chain.noise(radar)
    power = level_of(power_of(samples, radar, chain), radar, chain)
    _must_be_finite(power)
    if maps is not None:
        maps(power)
    found = cells_over(power, radar, chain)
    slow, fast = between_bins(power, found, noise)
    cell_noise = noise_about(power, found, chain.cfar.ring, noise.n_channels)
    sample_noise = cell_noise / noise_gain(noise.over_range, noise.over_velocity, frame.chirp)
    sample_noise = np.maximum(sample_noise, np.finfo(np.float32).tiny)
    tones = refine(samples, slow, fast, sample_noise, growth=growth(frame.chirp))
    if chain.mitigation:
        tones = _as_sent(tones, frame, chain)
    return Peaks(
        tones=tones,
        snr=np.maximum(tones.energy / sample_noise - noise.n_channels, 1e-3),
        amplitude_noise=sample_noise / (frame.n_chirps * frame.chirp.n_samples),
    )


def _as_sent(tones: Tones, frame: Frame, chain: Chain) -> Tones:
    """Tones with the power that clean-up took from targets of their velocity."""
    doppler_hz = principal_hz(tones, frame)
    passed = np.prod([one.passed(doppler_hz, frame) for one in chain.mitigation], axis=0)
    # Peaks lie where a tenth of the noise is left; beside a notch a target may have less.
    passed = np.maximum(passed, LEAST)
    amplitude = tones.amplitude / np.sqrt(passed)[:, None]
    return replace(tones, energy=tones.energy / passed, amplitude=amplitude)


def _unfolded(peaks: Peaks, radar: Radar, chain: Chain) -> Unfolded:
    """Peaks with their Doppler frequencies, where slots tell their folds."""
    frame, noise = radar.frame, peaks.amplitude_noise
    doppler_hz = principal_hz(peaks.tones, frame)
    if frame.n_slots == 1 or frame.n_chirps == 1:
        return Unfolded(peaks, doppler_hz, unknown(len(doppler_hz)))
    tones = peaks.tones
    if frame.modulation is not None:
        tones = replace(tones, amplitude=ramps.unshifted(tones.amplitude, tones.fast, frame))
        told = ramps.folds(tones.amplitude, frame, doppler_hz, peaks.snr, noise)
    elif tells_directions(radar):
        answers = responses(radar, aperture_of(radar, chain.field_of_view))
        told = folds(tones.amplitude, frame, doppler_hz, answers, noise)
    else:
        told = unknown(len(doppler_hz))
    doppler_hz = doppler_hz + np.nan_to_num(told.certain) / frame.repetition_s
    return Unfolded(peaks._replace(tones=tones), doppler_hz, told)


def _must_be_of(cube: xr.DataArray, radar: Radar) -> None:
    """Raise `InvalidSetting` unless the cube could be that radar's."""
    chirp = radar.frame.chirp
    if not isinstance(cube, xr.DataArray):
        raise InvalidSetting(
            "cube",
            got=f"of the kind {type(cube).__name__}",
            need=f"an xarray.DataArray over {', '.join(CUBE_AXES)}",
            fix="Name its axes: xarray.DataArray(array, dims=(...)).",
        )
    if set(cube.dims) == set(CUBE_AXES) and not cube.sizes["frame"]:
        raise InvalidSetting(
            "cube", got="without frames", need="one or more", fix="Give frames that are there."
        )
    if set(cube.dims) != set(CUBE_AXES):
        raise InvalidSetting(
            "cube",
            got=f"an array over {', '.join(map(str, cube.dims))}",
            need=f"over {', '.join(CUBE_AXES)}",
            fix="Name the axes so, and give missing ones length 1 with expand_dims.",
        )
    asked = {"chirp": radar.frame.n_sent, "rx": radar.array.n_rx, "sample": chirp.n_samples}
    for name, size in asked.items():
        if cube.sizes[name] != size:
            raise InvalidSetting(
                "cube",
                got=f"{cube.sizes[name]} along {name}",
                need=f"{size}, as the radar has",
                fix="Give the radar that the cube was taken with.",
            )
    must_be_sampled_as(chirp, cube, where="cube")


def _must_be_finite(power: np.ndarray) -> None:
    # One sample that is not finite reaches every cell, so one cell tells.
    if not np.isfinite(power[0, 0]):
        raise InvalidSetting(
            "cube",
            got="samples that are not finite (NaN or infinite)",
            need="finite samples throughout",
            fix="Find what wrote them, or replace them by zeros.",
        )
