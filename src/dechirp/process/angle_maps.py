"""Power over directions: at every range of a frame, and of one detection."""

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
import xarray as xr

from dechirp.core.conventions import axis
from dechirp.core.errors import InvalidSetting
from dechirp.core.threads import in_threads, slices
from dechirp.process.angle.bartlett import Bartlett
from dechirp.process.angle.base import SpectralEstimator
from dechirp.process.chain import Chain
from dechirp.process.folds import ramps
from dechirp.process.mirrored_beams import beams, keep_strongest
from dechirp.process.range_walk import growth, undone_by
from dechirp.process.refine import Tones, refine
from dechirp.process.sources import aperture_of, middle_m, range_from_m, snapshots
from dechirp.process.spectrum import FrameTransform, Transform, split_spectrum
from dechirp.process.virtual import channels, turns
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

# Directions of a spectrum over one angle for each of the grid that peaks are looked for on.
_FINER = 4
# Of the other detections of a frame, the strongest whose sidelobes are taken off.
_OTHERS = 32


def range_azimuth_map(cube: xr.DataArray, radar: Radar, chain: Chain | None = None) -> xr.DataArray:
    """Power over azimuth and range of one frame, (chirp, rx, sample).

    A beam towards each direction, in each cell of the range-Doppler map without padding; of all
    velocities, and elevations where the array tells them, the strongest is kept. So is that of
    the noise, some 8 dB over its mean.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample)
        Complex or real samples of one frame, any order of axes.
    radar : Radar
        The radar that it was taken with, with its calibration.
    chain : Chain, optional
        Its windows and its field of view.

    Returns
    -------
    DataArray (azimuth, range), W
        `azimuth` (rad) left positive, in even steps of its sine; `range` (m) with
        range-Doppler coupling left in; both from the middle of the array. A target on a bin has
        the power of its echo in one element. Of uncalibrated samples, in full scale squared.

    Raises
    ------
    InvalidSetting
        If the array tells no azimuth.

    Notes
    -----
    Transmitters are parted, and the motion between them undone, for the velocity of each cell.
    Velocities are those about zero: a target of another fold stands at a wrong azimuth where
    transmitters take turns. `detect` unfolds them.
    """
    chain = chain or Chain()
    samples, radar = _rising(cube, radar)
    made = _made(radar, chain)
    spectrum = split_spectrum(
        samples, radar.frame.chirp.sampling, made.over_range, made.over_velocity, made.transform
    )
    n_threads = numba.get_num_threads()
    parts = slices(len(spectrum), n_threads)
    powers = np.zeros((len(parts), *made.empty.shape), np.float32)

    def look(part: int) -> None:
        heard = _aligned(spectrum[parts[part]], made.beats, radar)
        keep_strongest(powers[part], heard, made.still[parts[part]], made.folding, made.weights)

    in_threads(n_threads, look, range(len(parts)))
    power = made.empty.copy(deep=False, data=powers.max(axis=0))
    return power.assign_attrs(units=_units(cube))


class _Made(NamedTuple):
    """What maps of one radar need once."""

    over_range: Transform
    over_velocity: Transform
    transform: FrameTransform
    beats: np.ndarray
    """Of each range, rad a sample."""
    still: np.ndarray
    folding: np.ndarray
    weights: np.ndarray
    """See `keep_strongest`."""
    empty: xr.DataArray
    """A map without power."""


@lru_cache(maxsize=8)  # 0.7 ms of 5
def _made(radar: Radar, chain: Chain) -> _Made:
    seen = aperture_of(radar, chain.field_of_view)
    if not seen.tells[0]:
        raise InvalidSetting(
            "radar.array",
            got="an upright line of elements",
            need="elements at several places along y: they tell azimuths",
            fix="Ask for elevations, with `angle_spectrum`.",
        )
    frame, chirp = radar.frame, radar.frame.chirp
    over_range, over_velocity = (
        Transform(window=window, n_points=n, n_bins=n)
        for window, n in (
            (chain.range_window, chirp.n_samples),
            (chain.doppler_window, frame.n_chirps),
        )
    )
    range_m = chirp.range_bins_m()
    n_velocities = frame.n_chirps
    doppler_hz = (np.arange(n_velocities) - n_velocities // 2) / (n_velocities * frame.repetition_s)
    folded, weights = beams(seen)
    still, parted = _parting(doppler_hz, radar)
    azimuth_rad = seen.grid.azimuth_rad
    return _Made(
        over_range=over_range,
        over_velocity=over_velocity,
        transform=undone_by(chain.range_walk, chirp),
        beats=2 * np.pi / over_range.n_bins * np.arange(range_m.size),
        still=still,
        folding=(parted @ folded).astype(np.complex64),
        weights=weights,
        empty=xr.DataArray(
            np.zeros((azimuth_rad.size, range_m.size), np.float32),
            dims=("azimuth", "range"),
            coords={"azimuth": axis("azimuth", azimuth_rad), "range": axis("range", range_m)},
            attrs={"long_name": "power"},
        ),
    )


def angle_spectrum(
    cube: xr.DataArray, radar: Radar, found: xr.Dataset, which: int, chain: Chain | None = None
) -> xr.DataArray:
    """Spectrum over directions of one detection.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample)
        The frame of the detection.
    radar : Radar
        The radar as it is in that frame, see `Radar.at`.
    found : Dataset over `detection`
        The detections of the frame, from `detect`.
    which : int
        Place of the one that is looked at.
    chain : Chain, optional
        Its estimator makes the spectrum; beams do (Bartlett) where it has none.

    Returns
    -------
    DataArray (elevation, azimuth)
        In rad from the middle of the array, where detections have them from the origin; in even
        steps of their sines; one value where the array does not tell it. The
        attribute `estimator` says which made it. Beams are powers in one element, in W;
        spectra of other estimators have scales of their own.

    Raises
    ------
    InvalidSetting
        If the array tells no direction.
    """
    chain = chain or Chain()
    samples, radar = _rising(cube, radar)
    seen = aperture_of(radar, chain.field_of_view)
    tones, doppler_hz, noise = _tone(samples, radar, found, which)
    amplitude = ramps.unshifted(tones.amplitude, tones.fast, radar.frame)
    heard, noise = snapshots(amplitude, doppler_hz, noise, radar)
    estimator = chain.angle if isinstance(chain.angle, SpectralEstimator) else Bartlett()
    azimuth, elevation = seen.grid.azimuth_rad, seen.grid.elevation_rad
    if not all(seen.tells):
        azimuth, elevation = _finer(azimuth), _finer(elevation)
    steering = seen.steering(azimuth, elevation[:, None]).reshape(-1, seen.n_elements)
    spectrum = estimator.at(estimator.prepared(heard, seen, noise), steering)
    return xr.DataArray(
        spectrum.reshape(len(elevation), len(azimuth)),
        dims=("elevation", "azimuth"),
        coords={
            "elevation": axis("elevation", elevation),
            "azimuth": axis("azimuth", azimuth),
        },
        attrs={
            "units": _units(cube),
            "long_name": "spectrum over directions",
            "estimator": type(estimator).kind(),
        },
    )


def _slots_repeat(frame: Frame) -> bool:
    """Whether slots are of one transmitter: each cell brings them in phase by itself."""
    return frame.multiplexing is None and frame.n_slots > 1


def _parting(doppler_hz: np.ndarray, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
    """What undoes the motion between slots, (velocity, channel) complex64, and then the code.

    From channels to elements, (channel, element), or from those of `_in_phase`.
    """
    n_rx, n_slots = radar.array.n_rx, radar.frame.n_slots
    if _slots_repeat(radar.frame):
        return np.ones((len(doppler_hz), n_rx), np.complex64), np.eye(n_rx)
    still = np.repeat(turns(radar.frame, doppler_hz).conj(), n_rx, axis=1)
    nothing = np.zeros(n_slots * n_rx)
    heard, _ = snapshots(np.eye(n_slots * n_rx), nothing, nothing, radar)
    return still.astype(np.complex64), heard[:, 0]


def _aligned(spectrum: np.ndarray, beats: np.ndarray, radar: Radar) -> np.ndarray:
    """Slots as if their ramps were alike, those of one transmitter as one; parts apart."""
    frame = radar.frame
    if frame.ramps_are_alike and not _slots_repeat(frame):
        return spectrum
    heard = spectrum[:, :, 0] + 1j * spectrum[:, :, 1]
    if not frame.ramps_are_alike:
        alike = np.ones((len(beats), heard.shape[1]), np.complex64)
        heard *= ramps.unshifted(alike, beats, frame).T
    if _slots_repeat(frame):
        heard = _in_phase(heard, radar)
    return np.stack([heard.real, heard.imag], axis=2)


def _in_phase(spectrum: np.ndarray, radar: Radar) -> np.ndarray:
    """Slots of one transmitter as one, (velocity, element, range) complex64."""
    n_velocities, _, n_rows = spectrum.shape
    heard = np.empty((n_velocities, radar.array.n_rx, n_rows), np.complex64)
    nothing = np.zeros(n_rows)
    for one, cells in zip(heard, spectrum, strict=True):
        one[:] = snapshots(cells.T, nothing, nothing, radar)[0][:, 0].T
    return heard


def _rising(cube: xr.DataArray, radar: Radar) -> tuple[np.ndarray, Radar]:
    """Samples of one frame, (chirp, channel, sample), and their radar: of rising ramps alone."""
    kind = np.complex64 if radar.frame.chirp.sampling == "complex" else np.float32
    samples = np.ascontiguousarray(cube.variable.transpose("chirp", "rx", "sample").values, kind)
    samples = channels(samples, radar.frame)
    if not radar.frame.falls:
        return samples, radar
    return np.ascontiguousarray(samples[:, : radar.array.n_rx]), radar.one_sided()


def _tone(
    samples: np.ndarray, radar: Radar, found: xr.Dataset, which: int
) -> tuple[Tones, np.ndarray, np.ndarray]:
    """The tone of a detection, its Doppler frequency, and the noise in its amplitude, of one each.

    The sidelobes of other detections are taken off, as they were when it was found.
    """
    frame, chirp = radar.frame, radar.frame.chirp
    offset_m = 0.0 if radar.calibration is None else radar.calibration.range_offset_m
    angles = found.azimuth.values, found.elevation.values
    middle = middle_m(*angles, found.fold.values, radar)
    range_m = range_from_m(middle, found.range.values, *angles) + offset_m
    # Sources of one detection share their place but for rounding, and their ratios add up.
    places = np.stack([range_m.round(9), np.nan_to_num(found.velocity.values)])
    tones_at, of = np.unique(places, axis=1, return_inverse=True)
    snr = np.bincount(of, found.snr.values)
    own = of[which]
    order = np.argsort(-snr, kind="stable")
    order = np.union1d(order[:_OTHERS], own)
    order = order[np.argsort(-snr[order], kind="stable")]
    beat_hz, doppler_hz = chirp.echo_frequencies_hz(*tones_at[:, order])
    tones = refine(
        samples,
        2 * np.pi * frame.repetition_s * doppler_hz,
        2 * np.pi / chirp.sample_rate_hz * beat_hz,
        np.zeros(len(order)),
        growth=growth(chirp),
    )
    at = np.flatnonzero(order == own)
    one = Tones(tones.slow[at], tones.fast[at], tones.energy[at], tones.amplitude[at])
    n_samples = frame.n_chirps * chirp.n_samples
    sample_noise = one.energy / (snr[own] + samples.shape[1])
    return one, doppler_hz[at], sample_noise / n_samples


def _finer(angle_rad: np.ndarray) -> np.ndarray:
    """The same angles and others between them, even in their sines."""
    n = _FINER * (len(angle_rad) - 1) + 1
    return np.arcsin(np.linspace(np.sin(angle_rad[0]), np.sin(angle_rad[-1]), n))


def _units(cube: xr.DataArray) -> str:
    return "W" if cube.attrs.get("units") == "sqrt(W)" else "full scale squared"
