"""Four lessons on FMCW radar: each draws a figure for the positions of its controls.

`lessons.html` runs this file in a browser, with the Pyodide distribution of Python.
"""

import dataclasses
import io
import json

import numpy as np
from matplotlib.figure import Figure
from scipy.constants import c

import dechirp as dc

RADAR = dc.design(max_range_m=200, range_resolution_m=1, max_velocity_m_per_s=100).radar
CHIRP = RADAR.frame.chirp
ONE_CHIRP = dataclasses.replace(RADAR, frame=dataclasses.replace(RADAR.frame, n_chirps=1))
WINDOWS = ["rectangular", "hann", "blackman-harris"]
CAR_RANGE_M, CAR_VELOCITY_M_PER_S = 50.0, 10.0

LESSONS = [
    {
        "title": "1. The chirp",
        "text": "The echo is a copy of the ramp, delayed by 2 R / c. The beat frequency is the"
        " difference of both frequencies, 2 S R / c.",
        "controls": [
            {"label": "Range (m)", "min": 5, "max": 200, "step": 1, "value": 50},
            {"label": "Number of samples shown", "min": 50, "max": 2200, "step": 50, "value": 600},
        ],
    },
    {
        "title": "2. The range transform",
        "text": "More samples make narrower bins, c / 2B. Sidelobes of a strong echo hide a weak"
        " one 12 m further on; a window lowers them.",
        "controls": [
            {"label": "Number of samples", "min": 100, "max": 2200, "step": 100, "value": 2200},
            {"label": "Weak echo (dB)", "min": -70, "max": 0, "step": 1, "value": -40},
            {"label": "Window", "options": WINDOWS},
        ],
    },
    {
        "title": "3. Velocity and detection",
        "text": "The phase advances from chirp to chirp with the velocity. Without guard cells"
        " between it and the three training cells on each side, the target raises its own threshold"
        " and is masked.",
        "controls": [
            {"label": "Velocity (m/s)", "min": -180, "max": 180, "step": 5, "value": 10},
            {"label": "Guard cells", "min": 0, "max": 12, "step": 1, "value": 4},
        ],
    },
    {
        "title": "4. The weakest detectable echo",
        "text": "The gain of both transforms, 54.5 dB, lifts an echo far below the noise over the"
        " threshold of cell averaging.",
        "controls": [
            {"label": "SNR per sample (dB)", "min": -48, "max": -15, "step": 1, "value": -36},
            {"label": "Number of the frame", "min": 1, "max": 50, "step": 1, "value": 1},
        ],
    },
]


def describe_lessons() -> str:
    """Return titles, texts and controls as JSON."""
    return json.dumps(LESSONS)


def draw_lesson(number: int, positions: str) -> str:
    """Return the figure of a lesson as SVG, for the positions of its controls as JSON."""
    figure = Figure(figsize=(7, 4.2), layout="constrained")
    draw = (draw_chirp, draw_range_transform, draw_velocity, draw_noise)[number]
    draw(figure, *json.loads(positions))
    svg = io.StringIO()
    figure.savefig(svg, format="svg")
    return svg.getvalue()


def simulate_echo(radar: dc.Radar, range_m: float, velocity_m_per_s: float = 0.0) -> np.ndarray:
    """Return the samples (chirp, sample) of one point target, with a mean power of 1."""
    target = dc.Target(
        position_m=(range_m, 0, 0), velocity_m_per_s=(velocity_m_per_s, 0, 0), rcs_m2=10
    )
    engine = dc.Engine(late="onset")
    scene = dc.Scene(targets=[target])
    samples = dc.simulate(scene, radar, impairments=[], engine=engine).values[0, :, 0]
    return samples / np.sqrt(np.mean(abs(samples) ** 2))


def draw_noise_samples(seed: int) -> np.ndarray:
    """Draw the noise of one frame, of power 1."""
    shape = (RADAR.frame.n_chirps, CHIRP.n_samples, 2)
    parts = np.random.default_rng(seed).standard_normal(shape, np.float32)
    return parts.view(np.complex64)[..., 0] / np.sqrt(2, dtype=np.float32)


def compute_map_and_threshold(
    samples: np.ndarray, n_training: tuple[int, int], n_guard: tuple[int, int], window: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return power and threshold (velocity, range) up to 200 m."""
    power = dc.maps.range_doppler_map(samples, window)[:, :201]
    return power, dc.cfar.cfar_threshold(power, n_training, n_guard, 1e-6, window=window)


def draw_chirp(figure: Figure, range_m: float, n_shown: float) -> None:
    """Draw the ramps and the beat signal."""
    top, bottom = figure.subplots(2, 1, sharex=True)
    time_us = np.arange(CHIRP.n_samples) / CHIRP.sample_rate_hz * 1e6
    delay_us = 2 * range_m / c * 1e6
    slope_mhz_per_us = CHIRP.slope_hz_per_s / 1e12
    received_mhz = np.where(time_us > delay_us, slope_mhz_per_us * (time_us - delay_us), np.nan)
    top.plot(time_us, slope_mhz_per_us * time_us, label="transmitted")
    top.plot(time_us, received_mhz, label="received")
    top.set(ylabel="Frequency - 77 GHz (MHz)")
    top.set_title(f"Beat frequency {CHIRP.beat_frequency_hz(range_m) / 1e6:.3f} MHz")
    top.legend(loc="upper left")
    bottom.plot(time_us, simulate_echo(ONE_CHIRP, range_m)[0].real)
    bottom.set(xlabel="Time since ramp start (µs)", ylabel="Beat signal, I")
    bottom.set_xlim(0, time_us[int(n_shown) - 1])


def draw_range_transform(figure: Figure, n_samples: float, weak_db: float, window: str) -> None:
    """Draw the spectra of a strong and a weak echo."""
    n = int(n_samples)
    echoes = [simulate_echo(ONE_CHIRP, range_m)[0, :n] for range_m in (50.0, 62.0)]
    spectrum = dc.maps.range_spectrum(
        echoes[0] + 10 ** (weak_db / 20) * echoes[1], window, n_bins=8 * n
    )
    resolution_m = c / 2 / (CHIRP.slope_hz_per_s * n / CHIRP.sample_rate_hz)
    range_m = np.arange(8 * n) / 8 * resolution_m
    power_db = 20 * np.log10(abs(spectrum) + 1e-9)
    axes = figure.subplots()
    axes.plot(range_m, power_db - power_db.max())
    axes.axvline(62, color="0.6", ls=":")
    axes.set(xlim=(20, 100), ylim=(-90, 3), xlabel="Range (m)", ylabel="Power (dB)")
    axes.set_title(f"Bin {resolution_m:.2f} m; dotted: the weak echo at 62 m")


def draw_velocity(figure: Figure, velocity_m_per_s: float, n_guard: float) -> None:
    """Draw the range-Doppler map of a target, and a cut along range with its threshold."""
    samples = simulate_echo(RADAR, CAR_RANGE_M, velocity_m_per_s) + 3 * draw_noise_samples(1)
    power, threshold = compute_map_and_threshold(samples, (0, 3), (0, int(n_guard)), "hann")
    row, column = np.unravel_index(power.argmax(), power.shape)
    velocity_bins = RADAR.frame.velocity_bins_m_per_s(len(power))
    left, right = figure.subplots(1, 2)
    power_db = 10 * np.log10(power / np.median(power))
    left.pcolormesh(np.arange(201), velocity_bins, power_db, vmin=0, vmax=40, rasterized=True)
    left.set(xlabel="Range (m)", ylabel="Velocity (m/s, receding positive)")
    left.set_title(f"Peak at {velocity_bins[row]:.1f} m/s, {column} m")
    right.plot(power_db[row], label="power")
    right.plot(10 * np.log10(threshold[row] / np.median(power)), label="threshold")
    right.set(xlim=(20, 80), xlabel="Range (m)", ylabel="Power over median noise (dB)")
    right.set_title("detected" if power[row, column] > threshold[row, column] else "masked")
    right.legend()


def draw_noise(figure: Figure, snr_db: float, frame_number: float) -> None:
    """Draw the cut through the car with its threshold, and the theory of its detection."""
    echo = simulate_echo(RADAR, CAR_RANGE_M, CAR_VELOCITY_M_PER_S)
    samples = 10 ** (snr_db / 20) * echo + draw_noise_samples(int(frame_number))
    power, threshold = compute_map_and_threshold(samples, (8, 10), (4, 12), "rectangular")
    clean = dc.maps.range_doppler_map(echo, "rectangular")
    row, column = np.unravel_index(clean.argmax(), clean.shape)
    noise_power = 1 / samples.size  # of a cell
    left, right = figure.subplots(1, 2)
    left.plot(10 * np.log10(power[row] / noise_power), label="power")
    left.plot(10 * np.log10(threshold[row] / noise_power), label="threshold")
    left.set(xlabel="Range (m)", ylabel="Power over mean noise (dB)", ylim=(-15, 45))
    left.set_title("detected" if power[row, column] > threshold[row, column] else "not detected")
    left.legend()
    snr_grid_db = np.linspace(-48, -15, 100)
    n_training = (2 * (8 + 4) + 1) * (2 * (10 + 12) + 1) - (2 * 4 + 1) * (2 * 12 + 1)
    factor = dc.theory.cell_averaging_factor(1e-6, n_training=n_training)
    gain = clean[row, column] / noise_power
    probability = dc.theory.cell_averaging_detection_probability(
        10 ** (snr_grid_db / 10) * gain, factor, n_training=n_training
    )
    right.plot(snr_grid_db, probability)
    right.axvline(snr_db, color="0.6", ls=":")
    right.set(xlabel="SNR per sample (dB)", ylabel="Detection probability, theory")
