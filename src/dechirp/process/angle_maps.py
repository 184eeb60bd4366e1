"""Power over directions: at every range of a frame, and of one detection."""

import numba
import numpy as np
import scipy.fft
import xarray as xr

from dechirp.core.conventions import axis
from dechirp.core.errors import InvalidSetting
from dechirp.core.threads import in_threads, slices
from dechirp.process.angle.bartlett import Bartlett
from dechirp.process.angle.base import SpectralEstimator
from dechirp.process.chain import Chain
from dechirp.process.folds import ramps
from dechirp.process.range_walk import undone_by
from dechirp.process.refine import Tones, refine
from dechirp.process.sources import aperture_of, middle_m, range_from_m, snapshots
from dechirp.process.spectrum import Transform
from dechirp.process.virtual import channels
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
    transform = undone_by(chain.range_walk, chirp)
    n_threads = numba.get_num_threads()
    with scipy.fft.set_workers(n_threads):
        spectrum = transform(samples, chirp.sampling, over_range, over_velocity)
    n_velocities, _, n_rows = spectrum.shape
    doppler_hz = (np.arange(n_velocities) - n_velocities // 2) / (n_velocities * frame.repetition_s)
    beats = 2 * np.pi / over_range.n_bins * np.arange(n_rows)
    weights = _as_real(seen.grid.steering.conj().T / seen.n_elements, seen.grid.shape)
    parted = _parted(doppler_hz, radar)
    parts = slices(n_velocities, n_threads)
    powers = np.zeros((len(parts), n_rows, len(seen.grid.azimuth_rad)), np.float32)

    def look(part: int) -> None:
        for velocity in range(n_velocities)[parts[part]]:
            heard = ramps.unshifted(spectrum[velocity].T, beats, frame)
            if parted is None:
                at_hz = np.full(n_rows, doppler_hz[velocity])
                heard = snapshots(heard, at_hz, np.zeros(n_rows), radar)[0][:, 0]
            else:
                heard = heard @ parted[velocity]
            numbers = np.ascontiguousarray(heard, np.complex64).view(np.float32)
            _keep_strongest(powers[part], numbers, weights)

    in_threads(n_threads, look, range(len(parts)))
    power = powers.max(axis=0)
    return xr.DataArray(
        power.T,
        dims=("azimuth", "range"),
        coords={
            "azimuth": axis("azimuth", seen.grid.azimuth_rad),
            "range": axis("range", chirp.range_bins_m()),
        },
        attrs={"units": _units(cube), "long_name": "power"},
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


def _parted(doppler_hz: np.ndarray, radar: Radar) -> np.ndarray | None:
    """From channels to elements at each velocity, (n, n_channels, n_elements) complex64.

    None for slots of one transmitter: each cell brings them in phase by itself.
    """
    frame = radar.frame
    if frame.multiplexing is None and frame.n_slots > 1:
        return None
    n = frame.n_slots * radar.array.n_rx
    each = np.tile(np.eye(n), (len(doppler_hz), 1))
    answers, _ = snapshots(each, np.repeat(doppler_hz, n), np.zeros(len(each)), radar)
    return answers.reshape(len(doppler_hz), n, -1).astype(np.complex64)


def _as_real(beams: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Weights (n, elevation x azimuth) for numbers of which two are a complex one.

    (elevation, 2 n, 2 azimuth) float32: real parts of the beams, then imaginary parts.
    """
    by_elevation = np.moveaxis(beams.reshape(-1, *shape), 0, 1)
    n_elevations, n, n_azimuths = by_elevation.shape
    out = np.empty((n_elevations, n, 2, 2, n_azimuths), np.float32)
    out[:, :, 0, 0] = out[:, :, 1, 1] = by_elevation.real
    out[:, :, 0, 1] = by_elevation.imag
    out[:, :, 1, 0] = -by_elevation.imag
    return out.reshape(n_elevations, 2 * n, 2 * n_azimuths)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _keep_strongest(power: np.ndarray, numbers: np.ndarray, weights: np.ndarray) -> None:
    """Raise powers (n, azimuth) to those of the beams of each row of numbers, in place.

    A product that keeps no beam: 7 ms for 32,768 snapshots of 12 elements and 89 directions,
    where transforms over the elements take 30.
    """
    n, n_azimuths = power.shape
    n_elevations, n_numbers, n_parts = weights.shape
    beams = np.empty(n_parts, np.float32)
    for e in range(n_elevations):
        for i in range(n):
            beams[:] = 0
            for k in range(0, n_numbers - 3, 4):
                a, b, c, d = numbers[i, k], numbers[i, k + 1], numbers[i, k + 2], numbers[i, k + 3]
                for j in range(n_parts):
                    beams[j] += (
                        a * weights[e, k, j]
                        + b * weights[e, k + 1, j]
                        + c * weights[e, k + 2, j]
                        + d * weights[e, k + 3, j]
                    )
            if n_numbers % 4:  # an odd number of elements
                a, b = numbers[i, n_numbers - 2], numbers[i, n_numbers - 1]
                for j in range(n_parts):
                    beams[j] += a * weights[e, n_numbers - 2, j] + b * weights[e, n_numbers - 1, j]
            for j in range(n_azimuths):
                here = beams[j] * beams[j] + beams[n_azimuths + j] * beams[n_azimuths + j]
                power[i, j] = max(power[i, j], here)


def _rising(cube: xr.DataArray, radar: Radar) -> tuple[np.ndarray, Radar]:
    """Samples of one frame, (chirp, channel, sample), and their radar: of rising ramps alone."""
    kind = np.complex64 if radar.frame.chirp.sampling == "complex" else np.float32
    samples = np.ascontiguousarray(cube.transpose("chirp", "rx", "sample").values, kind)
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
