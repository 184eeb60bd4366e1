"""Inputs of each job as plain arrays, readable by every package."""

import numpy as np

import dechirp as dc
from dechirp.config import loading
from dechirp.evaluation.track_trial import TrackTrial, draw_truth_and_detections
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.centroids import detections_to_resolution_cells
from dechirp.processing.cfar.base import TrainingWindow
from dechirp.processing.cluster import Reach
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.theory.direction_bounds import direction_std_rad
from sides import scenes
from sides.frames import CROSSING, build_radar, build_targets, simulate_frame
from sides.job_types import Inputs
from sides.plain_maps import GUARD, N_TRAINING_CELLS, TRAINING

SNR = 100.0


def echoes(case: scenes.Case) -> Inputs:
    scatterers, transmission, (_, _, n_samples) = case
    shared: list[dict[str, object]] = [scatterers._asdict(), transmission._asdict()]
    arrays = {k: np.asarray(v) for named in shared for k, v in named.items() if v is not None}
    return arrays | {"n_samples": np.array(n_samples)}


def unpack_case(x: Inputs) -> tuple[Scatterers, Transmission]:
    """Convert the inputs back to scatterers and transmission."""
    numbers = ("start_frequency_hz", "slope_hz_per_s", "adc_start_s", "sample_rate_hz")
    return (
        Scatterers(x["path_m"], x["amplitudes"], x["tx_gains"], x["rx_gains"]),
        Transmission(
            x["starts_s"],
            x["weights"],
            x["tx_m"],
            x["rx_m"],
            *(float(x[name]) for name in numbers),
        ),
    )


def power_map(n_chirps: int, n_samples: int, n_bins: int) -> Inputs:
    cube, _ = simulate_frame(n_samples, n_chirps, 1, 1, n_targets=3)
    return {"samples": scale_to_noise(cube.values)[0, :, 0], "n_bins": np.array(n_bins)}


def scale_to_noise(samples: np.ndarray) -> np.ndarray:
    """Scale to a median amplitude of 1,000, because some packages add 1 to each power."""
    return np.ascontiguousarray(samples * np.float32(1e3 / np.median(abs(samples))))


def noise_maps(
    n_maps: int, n_velocity: int, n_range: int, pfa: float, power_step: float = 1
) -> Inputs:
    """Draw exponential power maps and compute the threshold factors for plain code."""
    rng = np.random.default_rng(1)
    power = rng.exponential(size=(n_maps, n_velocity, n_range)).astype(np.float32)
    power[..., n_range // 2 :] *= power_step
    window = TrainingWindow(
        n_training=dc.Cells(velocity=TRAINING[0], range=TRAINING[1]),
        n_guard=dc.Cells(velocity=GUARD[0], range=GUARD[1]),
    )
    rank = 3 * N_TRAINING_CELLS // 4
    training_cells = window.training_cell_offsets(window.half_range)
    factors = [
        estimator.independent_cells_threshold_factor(pfa, training_cells, n_channels=1)
        for estimator in (dc.cfar.CellAveraging(), dc.cfar.OrderedStatistic(rank=rank))
    ]
    return {
        "power": power,
        "false_alarm_probability": np.array(pfa),
        "mean_factor": np.array(factors[0]),
        "rank_factor": np.array(factors[1]),
        "rank": np.array(rank),
        "n_training": np.array(TRAINING),
        "n_guard": np.array(GUARD),
    }


def frame(n_samples: int, n_chirps: int, n_tx: int, n_rx: int) -> Inputs:
    """Simulate three targets in noise, with samples (chirp, channel, sample)."""
    cube, radar = simulate_frame(n_samples, n_chirps, n_tx, n_rx, n_targets=3)
    positions_m = np.array([target.position_m for target in build_targets(3)], float)
    speed = np.array([target.velocity_m_per_s for target in build_targets(3)], float)
    range_m = np.linalg.norm(positions_m, axis=1)
    pfa = dc.Chain().cfar.false_alarm_probability
    factors = noise_maps(1, 2, 2, pfa)
    return {
        "samples": scale_to_noise(cube.values).reshape(n_chirps, n_tx * n_rx, n_samples),
        "sizes": np.array([n_tx, n_rx, n_chirps, n_samples]),
        "mean_factor": factors["mean_factor"],
        "n_training": factors["n_training"],
        "n_guard": factors["n_guard"],
        "target_range_m": range_m,
        "target_velocity": np.sum(positions_m * speed, axis=1) / range_m,
        "range_step_m": np.array(radar.frame.chirp.range_resolution_m),
        "velocity_step": np.array(radar.frame.velocity_resolution_m_per_s),
    }


def snapshots(n: int, n_elements: int) -> Inputs:
    """Draw snapshots of one source each, with 20 dB SNR, for half-wavelength spacing."""
    rng = np.random.default_rng(3)
    aperture = Aperture(np.array([(0, i / 2, 0) for i in range(n_elements)]))
    azimuth = rng.uniform(-1, 1, n)
    noise = rng.normal(size=(2, n, n_elements)) / np.sqrt(2)
    x = np.sqrt(SNR) * aperture.steering_vectors(azimuth) + noise[0] + 1j * noise[1]
    sines = np.linspace(-1, 1, 181)
    bound = direction_std_rad(
        positions=aperture.positions,
        azimuth_rad=[0.0],
        elevation_rad=[0.0],
        amplitudes=[np.sqrt(SNR)],
        noise_power=1.0,
        unknown=aperture.resolves_azimuth_and_elevation,
    )[0, 0]
    return {
        "snapshots": x.astype(np.complex64),
        "steering": aperture.steering_vectors(np.arcsin(sines)).astype(np.complex64),
        "sines": sines,
        "load": np.array(1.0),
        "azimuth_rad": azimuth,
        "bound_rad": bound / np.cos(azimuth),
    }


def clustered_detections(n: int) -> Inputs:
    """Draw detections of objects with ten detections each, and their scaled coordinates.

    Coordinates are scaled so that the clustering distance is 1 on each axis. Objects are smaller
    than the clustering distance, and more than twice this distance apart.
    """
    rng = np.random.default_rng(5)
    radar = build_radar(256, 128, 3, 4)
    cell_m_per_s = radar.frame.velocity_resolution_m_per_s
    object_centres = np.array(
        [
            (r, v * cell_m_per_s, s)
            for r in range(20, 290, 15)
            for v in (-12, -4, 4, 12)
            for s in np.linspace(-0.75, 0.75, 7)
        ]
    )
    owner = np.arange(n) % (n // 10)
    range_m, velocity, sine = object_centres[owner].T
    columns = {
        "frame": np.zeros(n, int),
        "range": range_m + 0.8 * rng.normal(size=n),
        "velocity": velocity + 0.3 * cell_m_per_s * rng.normal(size=n),
        "azimuth": np.arcsin(sine) + 0.01 * rng.normal(size=n),
        "snr": 100 * rng.exponential(size=n),
    }
    unknown = {"elevation": np.full(n, np.nan), "ambiguity_number": np.full(n, np.nan)}
    cells = (
        detections_to_resolution_cells(columns | unknown, radar).cells / Reach().as_array_by_axis
    )
    return {f"detections_{name}": values for name, values in columns.items()} | {
        "points": cells[:, :3],
        "owner": owner,
    }


def tracking(n_frames: int) -> Inputs:
    """Draw the detections of the first frames of the example with ten crossing targets."""
    trial = loading.read_settings(CROSSING, TrackTrial)
    trial_data = draw_truth_and_detections(trial, 0)
    detections = trial_data.detections.isel(detection=trial_data.detections.frame.values < n_frames)
    area = np.prod([high - low for low, high in trial.false_alarms.range_azimuth_velocity_bounds])
    truth = np.stack([trial_data.truth.x.values, trial_data.truth.y.values], axis=-1)
    return {
        f"detections_{name}": detections[name].values for name in detections if name != "target"
    } | {
        "times_s": trial.times_s[:n_frames],
        "truth_m": np.swapaxes(truth, 0, 1)[:n_frames],
        "process_noise_m2_per_s3": np.array(trial.tracker.process_noise_m2_per_s3),
        "detection_probability": np.array(trial.tracker.detection_probability),
        "gate_probability": np.array(trial.tracker.gate_probability),
        "speed_std_m_per_s": np.array(trial.tracker.speed_std_m_per_s),
        "false_alarm_density": np.array(trial.false_alarms.per_frame / area),
        "confirm_after": np.array(trial.tracker.confirm_after),
        "drop_after": np.array(trial.tracker.drop_after),
    }


def dca1000_codes(n_chirps: int, n_rx: int, n_samples: int) -> Inputs:
    """Draw a frame in the two-lane format of a DCA1000: I I Q Q, one receiver after the other."""
    rng = np.random.default_rng(7)
    shape = (n_chirps, n_rx, n_samples)
    codes = rng.integers(-(2**15), 2**15, (*shape, 2), dtype=np.int16)
    groups = codes.reshape(-1, 2, 2).swapaxes(1, 2)
    return {
        "codes": np.ascontiguousarray(groups).reshape(-1),
        "shape": np.array(shape),
        "samples": (codes[..., 0] + 1j * codes[..., 1]).astype(np.complex64) / 32768,
    }
