"""Agreement and speed of detections drawn from theory, relative to simulated samples.

The scenes have six targets with the same SNR at different positions within a cell. Radars have one
receiver or eight virtual elements; targets are steady or Swerling 1. A further scene is that of the
reference radar. For each SNR the table gives:

* the detection probabilities from samples and from the statistical sensor, their difference, and
  its standard error
* the RMSE of the sensor divided by the RMSE from samples, with the standard error of this ratio
* the ratio of the mean estimated SNRs
* the false alarms per frame from samples and from the sensor

The last lines give the frames per second of the sensor, by processor time of one thread.

    python benchmarks/statistical_sensor.py [--trials 2000] [--snr 10 12 14]
"""

import argparse
import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import NamedTuple

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["NUMBA_NUM_THREADS"] = "1"

import numpy as np

import dechirp as dc
from dechirp.core.findings import PhysicsWarning
from dechirp.evaluation.association import Associator
from dechirp.experiments.link_budget import added_noise_power_w
from dechirp.experiments.scenario import Scenario, load, reference
from dechirp.experiments.statistical.sensor import StatisticalSensor
from dechirp.processing.cfar.base import Cells, Cfar
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.chain import Chain
from dechirp.processing.detect import detect_columns
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.simulation.impairments.noise import ThermalNoise

Frames = Callable[[], dict[str, np.ndarray]]
EXAMPLES = Path(__file__).parents[1] / "examples"
STDS = ("range_std", "velocity_std", "azimuth_std")
ERRORS = ("range_error_m", "velocity_error_m_per_s", "azimuth_error_rad")


def build_small_scenario(n_elements: int) -> Scenario:
    """Build a small radar, with TDM for several elements, and six targets."""
    half_m = 3.9e-3 / 2
    n_tx = 2 if n_elements > 1 else 1
    n_rx = n_elements // n_tx
    frame = Frame(
        chirp=Chirp(
            start_frequency_hz=76.5e9, slope_hz_per_s=20e12, adc_start_s=2e-6,
            ramp_duration_s=12e-6, sample_rate_hz=12.8e6, n_samples=112, sampling="complex",
        ),
        n_chirps=64,
        interval_s=15e-6,
        multiplexing=Tdm(order=(0, 1)) if n_tx > 1 else None,
    )  # fmt: skip
    array = Array(
        tx_m=tuple((0.0, k * n_rx * half_m, 0.0) for k in range(n_tx)),
        rx_m=tuple((0.0, k * half_m, 0.0) for k in range(n_rx)),
    )
    hardware = Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0, loss=1.0)
    radar = Radar(frame=frame, array=array, hardware=hardware)
    # Cells are 0.86 m and 1 or 2 m/s. Positions have different fractions of a cell, far apart.
    cell_m, cell_m_per_s = frame.chirp.range_resolution_m, frame.velocity_resolution_m_per_s
    positions_cells = [
        (18.0, -20.0),
        (18.5, 12.25),
        (50.25, -20.5),
        (50.0, 12.4),
        (83.3, -20.33),
        (83.75, 12.0),
    ]
    targets = []
    for row, (range_cells, velocity_cells) in enumerate(positions_cells):
        azimuth = np.radians(8.0 * row - 20)
        direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        range_m, velocity = range_cells * cell_m, velocity_cells * cell_m_per_s
        range_m -= frame.chirp.range_doppler_coupling_m(velocity)
        targets.append(
            dc.Target(
                position_m=tuple(range_m * direction),
                velocity_m_per_s=tuple(velocity * direction),
                rcs_m2=1e-5 * range_m**4 / 1e3,
            )
        )
    cfar = Cfar(
        estimator=CellAveraging(), n_training=Cells(range=8, velocity=6),
        n_guard=Cells(range=3, velocity=3), false_alarm_probability=1e-5,
    )  # fmt: skip
    return Scenario(
        name=f"{n_elements} elements",
        radar=radar,
        scene=dc.Scene(targets=tuple(targets)),
        chain=Chain(cfar=cfar),
    )


def set_snr(scenario: Scenario, snr_db: float, fluctuation: str) -> Scenario:
    """Set the same SNR in thermal noise for all targets."""
    truth = dc.truth(scenario.scene, scenario.radar)
    first_snr = float(truth.snr[0, 0])
    targets = tuple(
        replace(
            target,
            rcs_m2=target.rcs_m2 * 10 ** (snr_db / 10) / first_snr * first_snr / float(snr),
            fluctuation=fluctuation,
        )
        for target, snr in zip(scenario.scene.targets, truth.snr[:, 0], strict=True)
    )
    scene = replace(scenario.scene, targets=targets)
    return replace(scenario, scene=scene, impairments=(ThermalNoise(),))


class Score(NamedTuple):
    """Statistics of all trials."""

    probability: float
    n: int
    rmse: np.ndarray
    rmse_error: np.ndarray
    """Relative standard error of the RMSE."""
    false_alarms: float
    columns: dict[str, np.ndarray]


def score_trials(scenario: Scenario, frames: Frames, n_trials: int) -> Score:
    """Score the detections of single frames against the truth."""
    noise_w = added_noise_power_w(scenario, scenario.radar)
    truth = dc.truth(scenario.scene, scenario.radar, noise_power_w=noise_w)
    associator = Associator(truth, scenario.radar)
    n_found, n_false, errors, detected_snr = 0, 0, [], []
    for _ in range(n_trials):
        columns = frames()
        match = associator(columns)
        n_found += len(np.unique(match.target[match.target >= 0]))
        n_false += int(np.sum(match.target < 0))
        # A false alarm within two cells of a target counts as its detection. Errors above six
        # standard deviations are therefore excluded, as the theory does not describe them.
        is_near = match.target >= 0
        for name, std in zip(ERRORS, STDS, strict=True):
            is_near &= ~(abs(getattr(match, name)) > 6 * columns[std])
        errors.append(np.array([getattr(match, name) for name in ERRORS])[:, is_near])
        detected_snr.append(columns["snr"][match.target >= 0])
    squared = np.concatenate(errors, axis=1) ** 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # columns of NaN for angles not estimated
        mean = np.nanmean(squared, axis=1)
        spread = np.nanstd(squared, axis=1) / np.sqrt(squared.shape[1]) / mean / 2
    n = n_trials * len(scenario.scene.targets)
    return Score(
        n_found / n,
        n,
        np.sqrt(mean),
        spread,
        n_false / n_trials,
        {"snr": np.concatenate(detected_snr)},
    )


def compare(scenario: Scenario, n_trials: int) -> tuple[Score, Score]:
    """Score the detections from samples and those of the statistical sensor."""
    rng = np.random.default_rng(1)
    chain = scenario.chain.fit_to_radar(scenario.radar)

    def detect_from_samples() -> dict[str, np.ndarray]:
        cube = dc.simulate(
            scenario.scene, scenario.radar, seed=rng, impairments=scenario.impairments
        )
        return detect_columns([cube], scenario.radar, chain)

    sensor, sensor_rng = StatisticalSensor(scenario), np.random.default_rng(2)
    return (
        score_trials(scenario, detect_from_samples, n_trials),
        score_trials(scenario, lambda: sensor.draw_detections(sensor_rng), n_trials),
    )


def print_comparison(
    scenario: Scenario, snrs_db: list[float], fluctuation: str, n_trials: int
) -> None:
    print(f"{scenario.name}, {fluctuation}")
    print(
        "  snr   samples  sensor  diff    s.e.   rmse sensor / samples: range, velocity, azimuth"
        "       snr    false alarms"
    )
    for snr_db in snrs_db:
        sampled, drawn_score = compare(set_snr(scenario, snr_db, fluctuation), n_trials)
        p = (sampled.probability + drawn_score.probability) / 2
        error = np.sqrt(2 * max(p * (1 - p), 1e-9) / sampled.n)
        ratio = drawn_score.rmse / sampled.rmse
        spread = np.hypot(sampled.rmse_error, drawn_score.rmse_error)
        rmse_text = "  ".join(f"{r:5.3f} ({s:.3f})" for r, s in zip(ratio, spread, strict=True))
        snr = np.mean(drawn_score.columns["snr"]) / np.mean(sampled.columns["snr"])
        print(
            f"  {snr_db:4.1f}  {sampled.probability:.4f}  {drawn_score.probability:.4f}"
            f"  {drawn_score.probability - sampled.probability:+.4f}  {error:.4f}   {rmse_text}"
            f"   {snr:5.3f}"
            f"   {sampled.false_alarms:.4f} {drawn_score.false_alarms:.4f}",
            flush=True,
        )


def measure_speed(scenario: Scenario) -> None:
    sensor, rng = StatisticalSensor(scenario), np.random.default_rng(1)
    sensor.draw_detections(rng)
    start, n = process_time(), 0
    while process_time() - start < 2.0:
        sensor.draw_detections(rng)
        n += scenario.n_frames
    print(f"{scenario.name}: {n / (process_time() - start):.0f} frames/s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=2000, help="trials per SNR")
    parser.add_argument(
        "--snr", type=float, nargs="*", default=[12, 14, 15, 16, 17, 19, 24], help="SNRs in dB"
    )
    options = parser.parse_args()
    warnings.simplefilter("ignore", PhysicsWarning)
    for n_elements, offset_db in ((1, 0.0), (8, 4.0)):
        for fluctuation in ("steady", "swerling-1"):
            snrs_db = [snr_db + offset_db for snr_db in options.snr]
            print_comparison(build_small_scenario(n_elements), snrs_db, fluctuation, options.trials)
    print_comparison(reference(), [15, 16, 17, 18], "steady", options.trials)
    for name in ("highway", "corner-radar", "mimo"):
        measure_speed(load(EXAMPLES / f"{name}.yaml"))


if __name__ == "__main__":
    main()
