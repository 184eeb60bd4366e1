"""Arrays as other programs make them: right ones, and ones with a well-known mistake.

Everything is computed in plain NumPy, without the simulator and the transforms of the package.
The mistakes are those of threads: TI E2E 984958 (which part of a complex spectrum), MATLAB Answers
440066 (axes of the FFT), IlyaKuprov/Spinach #464 (linspace with both ends),
dayalannair/FMCW_FFT_Radar #29 (cells shifted by one), Xiangyu-Gao #22 (length of the FFT),
dsp.stackexchange 70349 and stpaine/FERS #13 (sign of the velocity), dsp.stackexchange 61973
(fftshift), RadarML/xwr #48 (order of I and Q), TI E2E 674256 (transmitters that take turns),
TI E2E 642095 (factor and decibels of CFAR).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import dechirp as dc
from dechirp.radar.multiplexing.tdm import Tdm

C = 299_792_458.0
NUMPY_WINDOWS = {"hann": np.hanning, "hamming": np.hamming, "blackman": np.blackman}


@dataclass
class Case:
    """A call of a diagnosis, and the setting that it should report."""

    kind: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    options: dict[str, Any]
    expected: str | None = None

    def settings(self) -> set[str]:
        """Return the settings of the mistakes that are found."""
        diagnosis = self.function(*self.arguments, **self.options)
        return {finding.setting for finding in diagnosis.findings}


@dataclass
class Scene:
    """Scatterers and the noise of a frame."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    amplitude: np.ndarray


def random_radar(rng, *, sampling=None, square=False, n_tx=1, n_samples=None) -> dc.Radar:
    """Return a radar of 24, 60 or 77 GHz with 32 to 128 chirps of 64 to 256 samples."""
    n_samples = n_samples or int(rng.choice([64, 100, 128, 200, 256]))
    n_chirps = n_samples if square else int(rng.choice([32, 48, 64, 128]))
    sample_rate_hz = rng.uniform(2e6, 20e6)
    sampled_s = n_samples / sample_rate_hz
    adc_start_s = rng.uniform(0.02, 0.1) * sampled_s
    ramp_s = adc_start_s + sampled_s * rng.uniform(1.05, 1.25)
    chirp = dc.Chirp(
        start_frequency_hz=rng.choice([24.0e9, 60e9, 77e9]),
        slope_hz_per_s=rng.uniform(150e6, 900e6) / sampled_s,
        adc_start_s=adc_start_s,
        ramp_duration_s=ramp_s,
        sample_rate_hz=sample_rate_hz,
        n_samples=n_samples,
        sampling=sampling or str(rng.choice(["complex", "real"])),
    )
    tx_m = [(0.0, 0.01 * k, 0.0) for k in range(n_tx)]
    frame = dc.Frame(
        chirp=chirp,
        n_chirps=n_chirps,
        interval_s=ramp_s * rng.uniform(1.15, 1.8),
        multiplexing=Tdm(order=tuple(range(n_tx))) if n_tx > 1 else None,
    )
    return dc.Radar(frame=frame, array=dc.Array(tx_m=tx_m, rx_m=[(0.0, 0.0, 0.0)]))


def random_scene(rng, radar, *, snr_db=None, n_static=None, n_moving=None) -> Scene:
    """Return walls and furniture that weaken with range, and moving targets.

    `snr_db` is that of the strongest echo in the map, of noise of power 1 a sample.
    """
    chirp, frame = radar.frame.chirp, radar.frame
    n_static = int(rng.integers(9, 16)) if n_static is None else n_static
    n_moving = int(rng.integers(1, 4)) if n_moving is None else n_moving
    n = n_static + n_moving
    limit_m = chirp.max_range_m
    range_m = limit_m * rng.uniform(0.06, 0.45 if chirp.sampling == "complex" else 0.9, n)
    rcs_db = rng.normal(0, 4, n)
    velocity = np.zeros(n)
    limit = frame.max_velocity_m_per_s
    velocity[n_static:] = rng.uniform(0.2, 0.85, n_moving) * limit * rng.choice([-1, 1], n_moving)
    # Walls of long corridors fall as R^-2, points as R^-4.
    level_db = rcs_db - 10 * rng.uniform(2, 4) * np.log10(range_m / range_m.min())
    level_db[n_static:] += rng.uniform(0, 10)
    snr_db = rng.uniform(45, 60) if snr_db is None else snr_db
    gain_db = 10 * np.log10(chirp.n_samples * frame.n_chirps)
    amplitude = 10 ** ((level_db - level_db.max() + snr_db - gain_db) / 20)
    return Scene(range_m=range_m, velocity_m_per_s=velocity, amplitude=amplitude)


def beat_samples(rng, radar, scene, *, phase=None, n_channels=1) -> np.ndarray:
    """Return beat samples (channel, chirp, sample) with noise of power 1.

    `phase(tau, t, f0, slope)` is the phase of an echo in cycles; the exact one by default.
    """
    chirp, frame = radar.frame.chirp, radar.frame.for_frame(0)
    t = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    starts = np.arange(frame.n_chirps) * frame.repetition_s
    shape = (n_channels, frame.n_chirps, chirp.n_samples)
    noise = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    samples = noise
    for range_m, velocity, amplitude in zip(
        scene.range_m, scene.velocity_m_per_s, scene.amplitude, strict=True
    ):
        tau = 2 * (range_m + velocity * (starts[:, None] + t)) / C
        cycles = (phase or exact_phase)(tau, t, chirp.start_frequency_hz, chirp.slope_hz_per_s)
        start = rng.uniform(size=(n_channels, 1, 1))
        samples = samples + amplitude * np.exp(2j * np.pi * (cycles + start))
    return samples if chirp.sampling == "complex" else np.sqrt(2) * samples.real


def exact_phase(tau, t, f0, slope):
    """Return the phase of transmitted times conjugated received signal."""
    return f0 * tau + slope * tau * t - slope * tau**2 / 2


def phase_of_frequency_times_time(tau, t, f0, slope):
    """Return the phase where both signals have the phase f(t) t instead of its integral."""
    return (f0 + slope * t) * t - (f0 + slope * (t - tau)) * (t - tau)


def phase_of_opposite_doppler(tau, t, f0, slope):
    """Return a beat of positive frequency whose carrier phase turns the wrong way."""
    return -f0 * tau + slope * tau * t


@dataclass
class Map:
    """A map (velocity, range) of powers, with its axes."""

    power: np.ndarray
    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    n_channels: int

    def arguments(self):
        """Return the arguments of `diagnose_map`."""
        return self.power, self.range_m, self.velocity_m_per_s


def make_map(rng, radar, samples, *, window="", padding=None, half=True, shift=True) -> Map:
    """Return the map of samples (channel, chirp, sample), as a textbook computes it."""
    frame, chirp = radar.frame.for_frame(0), radar.frame.chirp
    window = window or str(rng.choice(list(NUMPY_WINDOWS)))
    pad_range, pad_velocity = padding or (int(rng.choice([1, 1, 2])), int(rng.choice([1, 1, 2])))
    n_range, n_velocity = chirp.n_samples * pad_range, frame.n_chirps * pad_velocity
    weights = NUMPY_WINDOWS.get(window, np.ones)
    tapered = samples * weights(chirp.n_samples) * weights(frame.n_chirps)[:, None]
    spectrum = np.fft.fft(np.fft.fft(tapered, n_range, axis=-1), n_velocity, axis=-2)
    if chirp.sampling == "real" and half:
        spectrum = spectrum[..., : n_range // 2 + 1]
    if shift:
        spectrum = np.fft.fftshift(spectrum, axes=-2)
    power = np.mean(abs(spectrum) ** 2, axis=0)
    step_m = C * chirp.sample_rate_hz / (2 * chirp.slope_hz_per_s * n_range)
    wavelength_m = C / (chirp.start_frequency_hz + chirp.ramp_bandwidth_hz / 2)
    velocity = np.fft.fftshift(np.fft.fftfreq(n_velocity, frame.repetition_s)) * wavelength_m / 2
    return Map(power, np.arange(power.shape[1]) * step_m, velocity, len(samples))


def in_scale(power, scale):
    """Return powers in a scale of `diagnose_map`."""
    if scale == "decibels":
        return 10 * np.log10(power)
    return np.sqrt(power) if scale == "amplitude" else power


def random_map(rng, *, radar=None, scene=None, phase=None, swap=False, **options):
    """Return a random radar, its samples and its map."""
    radar = radar or random_radar(rng)
    scene = scene or random_scene(rng, radar)
    samples = beat_samples(rng, radar, scene, phase=phase, n_channels=int(rng.integers(1, 4)))
    if swap:
        samples = samples.imag + 1j * samples.real
    return radar, scene, make_map(rng, radar, samples, **options)


def diagnose_map_case(kind, rng, radar, made, expected=None, **options) -> Case:
    """Return the case of a map in a random scale."""
    scale = str(rng.choice(["power", "amplitude", "decibels"]))
    arguments = (in_scale(made.power, scale), made.range_m, made.velocity_m_per_s)
    options = {"scale": scale, "radar": radar, **options}
    if rng.uniform() < 0.5:
        options["n_summed"] = made.n_channels
    return Case(kind, dc.diagnosis.diagnose_map, arguments, options, expected)


# Right arrays


def right_map(rng):
    radar, _, made = random_map(rng)
    return diagnose_map_case("right map", rng, radar, made)


def right_map_without_radar(rng):
    _, _, made = random_map(rng)
    return diagnose_map_case("right map without radar", rng, None, made)


def right_map_with_target(rng):
    radar = random_radar(rng)
    scene = random_scene(rng, radar, n_moving=1)
    scene.amplitude[-1] = scene.amplitude.max()
    _, _, made = random_map(rng, radar=radar, scene=scene)
    return diagnose_map_case("right map with target", rng, radar, made, **target_of(scene))


def right_weak_map_without_window(rng):
    radar = random_radar(rng)
    scene = random_scene(rng, radar, snr_db=rng.uniform(17, 24), n_static=3)
    _, _, made = random_map(rng, radar=radar, scene=scene, window="none")
    return diagnose_map_case("right weak map without window", rng, radar, made)


def right_cropped_map(rng):
    radar, _, made = random_map(rng)
    kept = int(made.range_m.size * rng.uniform(0.6, 0.95))
    made.power, made.range_m = made.power[:, :kept], made.range_m[:kept]
    return diagnose_map_case("right cropped map", rng, radar, made)


def right_profile(rng):
    radar, _, made = random_map(rng)
    row = made.power[made.velocity_m_per_s.size // 2]
    arguments = (10 * np.log10(row), made.range_m)
    options = {"scale": "decibels", "radar": radar}
    return Case("right profile", dc.diagnosis.diagnose_map, arguments, options)


def right_samples(rng):
    radar = random_radar(rng, n_tx=int(rng.integers(1, 3)))
    if radar.frame.n_slots > 1:
        rounds = beat_samples(rng, radar, random_scene(rng, radar), n_channels=2)
        samples = rounds.transpose(1, 0, 2).reshape(1, -1, rounds.shape[-1])
    else:
        samples = beat_samples(rng, radar, random_scene(rng, radar), n_channels=3)
    return Case("right samples", dc.diagnosis.diagnose_samples, (samples, radar), {})


def right_fast_samples(rng):
    radar, scene = fast_scene(rng)
    samples = beat_samples(rng, radar, scene)
    return Case("right fast samples", dc.diagnosis.diagnose_samples, (samples, radar), {})


def right_few_echoes(rng):
    radar = random_radar(rng)
    scene = random_scene(rng, radar, n_static=0, n_moving=2)
    scene.range_m[:] = radar.frame.chirp.max_range_m * rng.uniform(0.1, 0.95, 2)
    samples = beat_samples(rng, radar, scene)
    return Case("right few echoes", dc.diagnosis.diagnose_samples, (samples, radar), {})


def right_threshold(rng):
    cells, pfa, mean, n = threshold_parts(rng)
    factor = n * (pfa ** (-1 / n) - 1)
    return threshold_case("right threshold", cells, pfa, factor * mean)


RIGHT = (
    right_map,
    right_map_without_radar,
    right_map_with_target,
    right_weak_map_without_window,
    right_cropped_map,
    right_profile,
    right_samples,
    right_fast_samples,
    right_few_echoes,
    right_threshold,
)


# Wrong arrays


def range_axis_to_half_the_sample_rate(rng):
    radar, _, made = random_map(rng, radar=random_radar(rng, sampling="complex"))
    made.range_m = made.range_m / 2
    return diagnose_map_case("range to fs/2", rng, radar, made, "range_m.scale")


def half_spectrum_to_the_sample_rate(rng):
    radar, _, made = random_map(rng, radar=random_radar(rng, sampling="real"))
    made.range_m = made.range_m * 2
    return diagnose_map_case("half spectrum to fs", rng, radar, made, "range_m.scale")


def range_axis_of_the_sample_count(rng):
    radar, _, made = random_map(rng, padding=(2, 1))
    made.range_m = made.range_m * 2
    return diagnose_map_case("range of the sample count", rng, radar, made, "range_m.scale")


def range_axis_with_both_ends(rng):
    radar, _, made = random_map(rng, radar=random_radar(rng, sampling="complex"))
    made.range_m = np.linspace(0, made.range_m[-1] + made.range_m[1], made.range_m.size)
    return diagnose_map_case("range with both ends", rng, radar, made, "range_m.scale")


def range_axis_of_the_whole_ramp(rng):
    radar, _, made = random_map(rng, padding=(1, 1))
    chirp = radar.frame.chirp
    made.range_m = made.range_m * chirp.sampled_bandwidth_hz / chirp.ramp_bandwidth_hz
    return diagnose_map_case("range of the whole ramp", rng, radar, made, "range_m.scale")


def range_axis_from_one(rng):
    radar, _, made = random_map(rng)
    made.range_m = made.range_m + made.range_m[1]
    return diagnose_map_case("range from one", rng, radar, made, "range_m.offset")


def both_halves_of_real_samples(rng):
    radar, _, made = random_map(rng, radar=random_radar(rng, sampling="real"), half=False)
    return diagnose_map_case("both halves", rng, radar, made, "range_m.mirror")


def velocity_axis_of_one_way_path(rng):
    radar, _, made = random_map(rng)
    made.velocity_m_per_s = made.velocity_m_per_s * 2
    return diagnose_map_case("velocity one way", rng, radar, made, "velocity_m_per_s.scale")


def velocity_axis_of_the_ramp_duration(rng):
    radar, _, made = random_map(rng)
    ratio = radar.frame.interval_s / radar.frame.chirp.ramp_duration_s
    made.velocity_m_per_s = made.velocity_m_per_s * ratio
    return diagnose_map_case("velocity of the ramp", rng, radar, made, "velocity_m_per_s.scale")


def velocity_axis_with_both_ends(rng):
    radar, _, made = random_map(rng)
    limit = -made.velocity_m_per_s[0]
    made.velocity_m_per_s = np.linspace(-limit, limit, made.velocity_m_per_s.size)
    return diagnose_map_case("velocity both ends", rng, radar, made, "velocity_m_per_s.scale")


def velocity_axis_of_one_slot(rng):
    radar, _, made = random_map(rng, radar=random_radar(rng, n_tx=int(rng.integers(2, 4))))
    made.velocity_m_per_s = made.velocity_m_per_s * radar.frame.n_slots
    return diagnose_map_case("velocity of one slot", rng, radar, made, "velocity_m_per_s.scale")


def velocity_axis_in_kilometres_per_hour(rng):
    radar, _, made = random_map(rng)
    made.velocity_m_per_s = made.velocity_m_per_s * 3.6
    return diagnose_map_case("velocity in km/h", rng, radar, made, "velocity_m_per_s.scale")


def fast_scene(rng):
    """Return a radar with a wide band and a long frame, and strong targets that move fast."""
    while True:
        radar = random_radar(rng)
        chirp, frame = radar.frame.chirp, radar.frame
        cells = 0.3 * frame.max_velocity_m_per_s * frame.duration_s / chirp.range_resolution_m
        if cells > 0.3 and frame.n_chirps >= 48:
            break
    scene = random_scene(rng, radar, snr_db=55, n_static=3, n_moving=2)
    scene.amplitude[:] = scene.amplitude.max() * 10 ** (-rng.uniform(0, 10, 5) / 20)
    limit = frame.max_velocity_m_per_s * rng.choice([-1, 1], 2)
    scene.velocity_m_per_s[-2:] = limit * np.array([rng.uniform(0.3, 0.45), rng.uniform(0.5, 0.8)])
    # A bowl of ranges that stay unaliased at twice the slope, apart from each other.
    places = (np.arange(5) + rng.uniform(0.3, 0.7, 5)) / 5
    scene.range_m[:] = chirp.max_range_m * (0.06 + 0.38 * rng.permutation(places))
    return radar, scene


def opposite_doppler_phase(rng):
    radar, scene = fast_scene(rng)
    samples = beat_samples(rng, radar, scene, phase=phase_of_opposite_doppler)
    return Case(
        "opposite Doppler",
        dc.diagnosis.diagnose_samples,
        (samples, radar),
        {},
        "velocity_m_per_s.sign",
    )


def target_of(scene):
    """Return the last target of a scene as options of a diagnosis."""
    return {
        "target_range_m": float(scene.range_m[-1]),
        "target_velocity_m_per_s": float(scene.velocity_m_per_s[-1]),
    }


def negative_velocity_axis(rng):
    radar = random_radar(rng)
    scene = random_scene(rng, radar, n_moving=1)
    scene.amplitude[-1] = scene.amplitude.max()
    _, _, made = random_map(rng, radar=radar, scene=scene)
    made.velocity_m_per_s = -made.velocity_m_per_s
    return diagnose_map_case(
        "negative velocity", rng, radar, made, "velocity_m_per_s.sign", **target_of(scene)
    )


def frequency_times_time(rng):
    radar, scene = fast_scene(rng)
    samples = beat_samples(rng, radar, scene, phase=phase_of_frequency_times_time)
    return Case("f(t) t", dc.diagnosis.diagnose_samples, (samples, radar), {}, "samples.phase")


def frequency_times_time_of_known_target(rng):
    radar = random_radar(rng)
    scene = random_scene(rng, radar, n_static=0, n_moving=1)
    scene.range_m[:] = radar.frame.chirp.max_range_m * rng.uniform(0.06, 0.45)
    samples = beat_samples(rng, radar, scene, phase=phase_of_frequency_times_time)
    return Case(
        "f(t) t of a known target",
        dc.diagnosis.diagnose_samples,
        (samples, radar),
        target_of(scene),
        "samples.phase",
    )


def missing_window(rng):
    radar, _, made = random_map(rng, window="none")
    return diagnose_map_case("missing window", rng, radar, made, "window")


def swapped_samples(rng):
    radar = random_radar(rng, sampling="complex")
    samples = beat_samples(rng, radar, random_scene(rng, radar))
    swapped = samples.imag + 1j * samples.real
    return Case("swapped samples", dc.diagnosis.diagnose_samples, (swapped, radar), {}, "iq")


def map_of_swapped_samples(rng):
    radar, _, made = random_map(rng, radar=random_radar(rng, sampling="complex"), swap=True)
    return diagnose_map_case("map of swapped samples", rng, radar, made, "iq")


def missing_fftshift(rng):
    radar, _, made = random_map(rng, shift=False)
    return diagnose_map_case("missing fftshift", rng, radar, made, "fftshift")


def amplitude_decibels(rng):
    radar, _, made = random_map(rng)
    arguments = (10 * np.log10(np.sqrt(made.power)), made.range_m, made.velocity_m_per_s)
    options = {"scale": "decibels", "radar": radar, "n_summed": made.n_channels}
    return Case("amplitude dB", dc.diagnosis.diagnose_map, arguments, options, "scale")


def amplitude_as_power(rng):
    radar, _, made = random_map(rng)
    arguments = (np.sqrt(made.power), made.range_m, made.velocity_m_per_s)
    options = {"scale": "power", "radar": radar, "n_summed": made.n_channels}
    return Case("amplitude as power", dc.diagnosis.diagnose_map, arguments, options, "scale")


def exchanged_axes_of_equal_length(rng):
    radar = random_radar(rng, square=True, n_samples=int(rng.choice([64, 100, 128])))
    samples = beat_samples(rng, radar, random_scene(rng, radar)).swapaxes(-1, -2)
    return Case("exchanged axes", dc.diagnosis.diagnose_samples, (samples, radar), {}, "axes")


def exchanged_axes(rng):
    radar = random_radar(rng, n_samples=200)
    samples = beat_samples(rng, radar, random_scene(rng, radar)).swapaxes(-1, -2)
    return Case("exchanged shape", dc.diagnosis.diagnose_samples, (samples, radar), {}, "axes")


def exchanged_map(rng):
    """Return the case of a map that is transposed after fftshift, with steps of either kind."""
    radar, _, made = random_map(rng)
    n_rows, n_columns = made.power.T.shape
    range_m, velocity = made.range_m, made.velocity_m_per_s
    if rng.uniform() < 0.5:
        made.range_m = np.arange(n_columns) * range_m[1]
        made.velocity_m_per_s = (np.arange(n_rows) - n_rows // 2) * (velocity[1] - velocity[0])
    else:
        made.range_m = np.linspace(0, range_m[-1], n_columns)
        made.velocity_m_per_s = np.linspace(velocity[0], -velocity[0], n_rows)
    made.power = made.power.T
    return diagnose_map_case(
        "exchanged map", rng, radar if rng.uniform() < 0.7 else None, made, "axes"
    )


def map_of_exchanged_samples(rng):
    """Return the case of a map of samples whose chirps and samples are exchanged."""
    radar = random_radar(rng)
    samples = beat_samples(rng, radar, random_scene(rng, radar))
    weights = np.outer(np.hanning(samples.shape[1]), np.hanning(samples.shape[2]))
    spectrum = np.fft.fftshift(np.fft.fft2((samples[0] * weights).T), axes=0)
    n_rows, n_columns = spectrum.shape
    right = make_map(rng, radar, samples, padding=(1, 1))
    step = right.velocity_m_per_s[1] - right.velocity_m_per_s[0]
    made = Map(
        abs(spectrum) ** 2,
        np.arange(n_columns) * right.range_m[1],
        (np.arange(n_rows) - n_rows // 2) * step,
        1,
    )
    return diagnose_map_case("map of exchanged samples", rng, radar, made, "axes")


def threshold_parts(rng):
    """Return noise with a target, the probability, training means and their number."""
    n_training = (int(rng.integers(0, 3)), int(rng.integers(3, 9)))
    n_guard = (int(rng.integers(0, 3)), int(rng.integers(1, 3)))
    power = rng.exponential(rng.uniform(0.1, 10), (32, 128))
    power[9, 50] *= 1e3
    pfa = 10 ** -rng.uniform(4, 8)
    mean = np.full_like(power, np.nan)
    (tv, tr), (gv, gr) = n_training, n_guard
    for row in range(32):
        rows = np.arange(row - tv - gv, row + tv + gv + 1) % 32
        for column in range(tr + gr, 128 - tr - gr):
            box = power[rows, column - tr - gr : column + tr + gr + 1].copy()
            box[tv : tv + 2 * gv + 1, tr : tr + 2 * gr + 1] = np.nan
            mean[row, column] = np.nanmean(box)
    n = (2 * (tv + gv) + 1) * (2 * (tr + gr) + 1) - (2 * gv + 1) * (2 * gr + 1)
    mean[np.isnan(mean)] = np.nanmean(mean)
    return (power, n_training, n_guard), pfa, mean, n


def threshold_case(kind, cells, pfa, threshold, expected=None):
    """Return the case of a threshold."""
    return Case(kind, dc.diagnosis.diagnose_threshold, (threshold, *cells, pfa), {}, expected)


def threshold_of_known_noise(rng):
    cells, pfa, mean, n = threshold_parts(rng)
    while n > 60:  # with many cells, both factors agree
        cells, pfa, mean, n = threshold_parts(rng)
    return threshold_case("known noise", cells, pfa, -np.log(pfa) * mean, "threshold")


def threshold_of_summed_cells(rng):
    cells, pfa, mean, n = threshold_parts(rng)
    threshold = (pfa ** (-1 / n) - 1) * mean
    return threshold_case("mean instead of sum", cells, pfa, threshold, "threshold")


WRONG = (
    range_axis_to_half_the_sample_rate,
    half_spectrum_to_the_sample_rate,
    range_axis_of_the_sample_count,
    range_axis_with_both_ends,
    range_axis_of_the_whole_ramp,
    range_axis_from_one,
    both_halves_of_real_samples,
    velocity_axis_of_one_way_path,
    velocity_axis_of_the_ramp_duration,
    velocity_axis_with_both_ends,
    velocity_axis_of_one_slot,
    velocity_axis_in_kilometres_per_hour,
    opposite_doppler_phase,
    negative_velocity_axis,
    frequency_times_time,
    frequency_times_time_of_known_target,
    missing_window,
    swapped_samples,
    map_of_swapped_samples,
    missing_fftshift,
    amplitude_decibels,
    amplitude_as_power,
    exchanged_axes_of_equal_length,
    exchanged_axes,
    exchanged_map,
    map_of_exchanged_samples,
    threshold_of_known_noise,
    threshold_of_summed_cells,
)
