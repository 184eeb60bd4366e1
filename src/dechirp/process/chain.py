"""The processing chain, from the samples of a frame to its detections."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple, get_args

import numpy as np
import xarray as xr

from dechirp.core.checks import count
from dechirp.core.conventions import CUBE_AXES, axis
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import must_fit
from dechirp.core.values import value
from dechirp.process.angle.aperture import FieldOfView
from dechirp.process.angle.base import DirectionEstimator
from dechirp.process.angle.fft import Fft
from dechirp.process.cfar.base import Cfar, Noise
from dechirp.process.cfar.cell_averaging import CellAveraging
from dechirp.process.estimates import estimates, noise_about, principal_hz
from dechirp.process.folds import intervals, ramps
from dechirp.process.folds.ambiguity import folds, responses, unknown
from dechirp.process.folds.pairing import Peaks, Unfolded, paired
from dechirp.process.interpolation import between_bins
from dechirp.process.peaks import clear_of_sidelobes, highest
from dechirp.process.range_walk import RangeWalk, growth, undone_by
from dechirp.process.refine import refine
from dechirp.process.sources import (
    aperture_of,
    from_origin,
    middle_m,
    sources,
    tells_directions,
    undirected,
)
from dechirp.process.spectrum import (
    Transform,
    independent_rows,
    mean_power,
    noise_gain,
)
from dechirp.process.virtual import channels
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window


@value
class Chain:
    """Settings of the chain, in the order in which they act."""

    range_window: Window = "hann"
    n_range_bins: int | None = None
    """Points of the range transform, zero-padded above n_samples; none: n_samples. Real
    sampling keeps the half of them that is not a mirror image."""
    doppler_window: Window = "hann"
    n_velocity_bins: int | None = None
    """Points of the Doppler transform, zero-padded above n_chirps; none: n_chirps."""
    range_walk: RangeWalk | None = None
    """How targets that cross range cells within a frame are kept in one, where v M T of the
    largest velocity exceeds half a cell; none: not at all. Segmented leaves lobes 75 dB below a
    target, keystone none."""
    cfar: Cfar = Cfar(estimator=CellAveraging(), false_alarm_probability=1e-6)
    angle: DirectionEstimator | None = Fft()
    """How directions are estimated; none: not at all. The default is left out where the array
    tells none."""
    field_of_view: FieldOfView = FieldOfView()
    """Directions that are looked in; without an estimator, for the folds of velocities alone."""
    cluster: None = None
    """Clustering: none is available yet."""

    def __post_init__(self) -> None:
        for name in ("n_range_bins", "n_velocity_bins"):
            if getattr(self, name) is not None:
                count(self, name, at_least=2)
        for name, choices in (
            ("range_window", get_args(Window)),
            ("doppler_window", get_args(Window)),
            ("range_walk", (*get_args(RangeWalk), None)),
        ):
            if getattr(self, name) not in choices:
                raise InvalidSetting(
                    f"Chain.{name}",
                    got=getattr(self, name),
                    need=" or ".join("none" if one is None else one for one in choices),
                    fix="Choose one of them.",
                )
        if not isinstance(self.angle, DirectionEstimator | None):
            raise InvalidSetting(
                "Chain.angle",
                got=self.angle,
                need="a member of the family, or none",
                fix="Give Fft(), or leave it out for the default.",
            )
        if not isinstance(self.cfar, Cfar):
            raise InvalidSetting(
                "Chain.cfar", got=self.cfar, need="a Cfar", fix="Leave it out for the default."
            )

    def over_range(self, chirp: Chirp) -> Transform:
        """The range transform for a chirp."""
        n_bins = chirp.n_samples if self.n_range_bins is None else self.n_range_bins
        return Transform(window=self.range_window, n_points=chirp.n_samples, n_bins=n_bins)

    def over_velocity(self, frame: Frame) -> Transform:
        """The Doppler transform for a frame."""
        n_bins = frame.n_chirps if self.n_velocity_bins is None else self.n_velocity_bins
        return Transform(window=self.doppler_window, n_points=frame.n_chirps, n_bins=n_bins)

    def fitted(self, radar: Radar) -> "Chain":
        """The same, without defaults that a radar has no room for.

        Fewer training cells where the default ones do not fit into the map, and no direction
        estimator instead of the default one where the array tells no direction.
        """
        n_rows = searched_rows(radar.frame.chirp, self.over_range(radar.frame.chirp))
        angle = None if self.angle == Fft() and not tells_directions(radar) else self.angle
        return replace(
            self, angle=angle, cfar=self.cfar.fitted(self.over_velocity(radar.frame).n_bins, n_rows)
        )

    def noise(self, radar: Radar) -> Noise:
        """What white noise looks like in the map of a radar."""
        return Noise(
            over_range=self.over_range(radar.frame.chirp),
            over_velocity=self.over_velocity(radar.frame),
            n_channels=radar.n_summed,
        )


def power_map(cube: xr.DataArray, radar: Radar, chain: Chain) -> xr.DataArray:
    """Range-Doppler map of one frame, (chirp, rx, sample), to (velocity, range).

    Mean power over the channels, see `channels`; a tone on a bin keeps its power.
    """
    noise = chain.noise(radar)
    samples = cube.transpose("chirp", "rx", "sample").values
    units = "W" if cube.attrs.get("units") == "sqrt(W)" else "full scale squared"
    return xr.DataArray(
        _power(channels(samples, radar.frame), radar, chain),
        dims=("velocity", "range"),
        coords={
            "velocity": axis(
                "velocity", radar.frame.velocity_bins_m_per_s(noise.over_velocity.n_bins)
            ),
            "range": axis("range", radar.frame.chirp.range_bins_m(noise.over_range.n_bins)),
        },
        attrs={"units": units, "long_name": "power"},
    )


def threshold_map(power: xr.DataArray, radar: Radar, chain: Chain) -> xr.DataArray:
    """Threshold of each cell of a map; infinite in rows where no false-alarm law holds.

    Those are the rows about DC and about half the sample rate of real sampling, see
    `process.spectrum.independent_rows`; they are not training cells either.
    """
    labelled = power.transpose("velocity", "range")
    threshold = _threshold(labelled.values, radar, chain)
    return labelled.copy(data=threshold).assign_attrs(long_name="threshold")


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
    _must_be_of(cube, radar)
    one_by_one = (cube.isel(frame=slice(at, at + 1)) for at in range(cube.sizes["frame"]))
    return detect_each(one_by_one, radar, chain)


def detect_each(
    cubes: Iterable[xr.DataArray], radar: Radar, chain: Chain | None = None, *, first: int = 0
) -> xr.Dataset:
    """Detections in cubes of one frame each, as `detect`; `first`: the number of the first one.

    A cube is asked for when the one before is done with. Of frames with intervals in turn, the
    amplitudes of all peaks are kept until the last: only then are folds, and directions, told.
    """
    chain = (chain or Chain()).fitted(radar)
    seen = (_seen(cube, radar, chain, number) for number, cube in enumerate(cubes, first))
    frames: Iterable[_Seen] = seen
    if radar.frame.n_intervals > 1 and radar.frame.n_chirps > 1:
        frames = _agreed(list(seen), radar.frame)
    columns = [_columns(one, chain) for one in frames]
    merged = {name: np.concatenate([c[name] for c in columns]) for name in _UNITS}
    return xr.Dataset(
        {name: ("detection", merged[name], {"units": units}) for name, units in _UNITS.items()}
    )


_UNITS = {
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


class _Seen(NamedTuple):
    """Peaks of one frame, with their Doppler frequencies."""

    number: int
    time_s: float
    """Mid-frame."""
    radar: Radar
    """With the interval of the frame."""
    found: Unfolded


def _seen(cube: xr.DataArray, radar: Radar, chain: Chain, number: int) -> _Seen:
    """What one frame alone tells, (frame, chirp, rx, sample)."""
    _must_be_of(cube, radar)
    start_s = cube.frame.item() if "frame" in cube.coords else radar.frame.start_s(number)
    radar = radar.at(number)
    frame = radar.frame
    kind = np.complex64 if frame.chirp.sampling == "complex" else np.float32
    sent = cube.variable.transpose(*CUBE_AXES).values[0]
    samples = channels(np.ascontiguousarray(sent, kind), frame)
    if frame.falls:
        n_rx, one_sided = radar.array.n_rx, radar.one_sided()
        up, down = (
            _peaks(np.ascontiguousarray(samples[:, half]), one_sided, chain)
            for half in (slice(n_rx), slice(n_rx, None))
        )
        found = paired(up, down, frame)
    else:
        found = _unfolded(_peaks(samples, radar, chain), radar, chain)
    return _Seen(number, float(start_s) + frame.mid_frame_s, radar, found)


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
    found, radar, frame = seen.found, seen.radar, seen.radar.frame
    tones, doppler_hz, noise = found.peaks.tones, found.doppler_hz, found.peaks.amplitude_noise
    if frame.falls:
        radar = radar.one_sided()
    if chain.angle is None:
        told = undirected(len(doppler_hz))
    else:
        view = aperture_of(radar, chain.field_of_view)
        told = sources(tones.amplitude, doppler_hz, noise, radar, chain.angle, view)
    of = told.detection
    snr = found.peaks.snr[of] * told.share
    columns = {
        "frame": np.full(len(of), seen.number),
        "time": np.full(len(of), seen.time_s),
        **estimates(tones.fast[of], doppler_hz[of], snr, frame, seen.radar.n_summed),
        "azimuth": told.azimuth_rad,
        "elevation": told.elevation_rad,
        "azimuth_std": told.azimuth_std_rad,
        "elevation_std": told.elevation_std_rad,
        "fold": found.folds.certain[of],
        "fold_confidence": found.folds.confidence[of],
    }
    if radar.calibration is not None:
        columns["range"] -= radar.calibration.range_offset_m
    at = told.azimuth_rad, told.elevation_rad
    columns["range"], columns["azimuth"], columns["elevation"] = from_origin(
        columns["range"], *at, middle_m(*at, columns["fold"], radar)
    )
    return columns


def _peaks(samples: np.ndarray, radar: Radar, chain: Chain) -> Peaks:
    """Peaks of the map of one frame, (chirp, channel, sample), refined on its samples."""
    frame, noise = radar.frame, chain.noise(radar)
    power = _power(samples, radar, chain)
    _must_be_finite(power)
    found = _found(power, radar, chain)
    slow, fast = between_bins(power, found, noise)
    cell_noise = noise_about(power, found, chain.cfar.ring, noise.n_channels)
    sample_noise = cell_noise / noise_gain(noise.over_range, noise.over_velocity, frame.chirp)
    sample_noise = np.maximum(sample_noise, np.finfo(np.float32).tiny)
    tones = refine(samples, slow, fast, sample_noise, growth=growth(frame.chirp))
    return Peaks(
        tones=tones,
        snr=np.maximum(tones.energy / sample_noise - noise.n_channels, 1e-3),
        amplitude_noise=sample_noise / (frame.n_chirps * frame.chirp.n_samples),
    )


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


def _power(samples: np.ndarray, radar: Radar, chain: Chain) -> np.ndarray:
    """Range-Doppler map of one frame, (chirp, channel, sample) to (velocity, range)."""
    noise = chain.noise(radar)
    cells = noise.over_range.n_bins * noise.over_velocity.n_bins
    must_fit(
        "range-Doppler map",
        needed_bytes=cells * (3 * 8.0 + 3 * 4.0),  # spectra of a channel, power, threshold
        fix="Take fewer range or velocity bins.",
    )
    chirp = radar.frame.chirp
    transform = undone_by(chain.range_walk, chirp)
    return mean_power(samples, chirp.sampling, noise.over_range, noise.over_velocity, transform)


def _found(power: np.ndarray, radar: Radar, chain: Chain) -> np.ndarray:
    """Peaks of a map, (n, 2), velocity and range, strongest first: as `peaks` of its threshold.

    Which cells exceed it, and the threshold of a few, are known in a fraction of the time that
    an ordered statistic takes for a whole map.
    """
    noise = chain.noise(radar)
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    searched = np.ascontiguousarray(power[:, rows])
    over = np.zeros(power.shape, bool)
    over[:, rows] = chain.cfar.exceeds(searched, noise)
    found = highest(power, over)
    threshold = chain.cfar.threshold_at(searched, found - (0, rows.start), noise)
    return clear_of_sidelobes(power, found, threshold, noise)


def _threshold(power: np.ndarray, radar: Radar, chain: Chain) -> np.ndarray:
    """Threshold of each cell, infinite outside the rows that are searched."""
    noise = chain.noise(radar)
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    if rows == slice(0, power.shape[1]):
        return chain.cfar.threshold(power, noise)
    threshold = np.full_like(power, np.inf)
    threshold[:, rows] = chain.cfar.threshold(np.ascontiguousarray(power[:, rows]), noise)
    return threshold


def searched_rows(chirp: Chirp, over_range: Transform) -> int:
    """Range rows of a map in which targets are looked for."""
    if chirp.sampling == "complex":
        return over_range.n_bins
    n_rows = over_range.n_bins // 2 + 1
    # In a large map the few rows that the noise law leaves out make no odds, and finding them
    # takes the square of their number.
    if n_rows > 2048:
        return n_rows
    rows = independent_rows(chirp, over_range)
    return rows.stop - rows.start


def _must_be_of(cube: xr.DataArray, radar: Radar) -> None:
    """Raise `InvalidSetting` unless the cube could be that radar's."""
    chirp = radar.frame.chirp
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
    if np.iscomplexobj(cube) != (chirp.sampling == "complex"):
        raise InvalidSetting(
            "cube",
            got=f"samples of type {cube.dtype}",
            need=f"{chirp.sampling} samples, as the chirp says",
            fix="Set the chirp's sampling to what the converter takes.",
        )


def _must_be_finite(power: np.ndarray) -> None:
    # One sample that is not finite reaches every cell, so one cell tells.
    if not np.isfinite(power[0, 0]):
        raise InvalidSetting(
            "cube",
            got="samples that are not finite (NaN or infinite)",
            need="finite samples throughout",
            fix="Find what wrote them, or replace them by zeros.",
        )
