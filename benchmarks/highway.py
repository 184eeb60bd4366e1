"""Simulated frames per second of a highway scene, with hardware impairments.

The scene has twenty cars, vans and trucks with turning wheels, about 3,000 scatterers in total. The
TDM radar has three transmitters and four receivers, 128 chirps per transmitter and 256 samples.
Impairments are those of `automotive-chip`; 20 frames are simulated.

The table gives the time per frame without impairments, with all, and with each impairment alone,
relative to the time without impairments. The last line compares the phase-noise stage for all
scatterers with the stage for two scatterers at the smallest and largest range.

    python benchmarks/highway.py [--threads 2] [--frames 20]
"""

import argparse
import json
import os
import warnings
from collections.abc import Callable
from statistics import median
from time import perf_counter

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--threads", type=int, default=2, help="threads of the simulation")
parser.add_argument("--frames", type=int, default=20, help="number of simulated frames")
options = parser.parse_args()
for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[pool] = "1"
os.environ["NUMBA_NUM_THREADS"] = str(options.threads)

import numpy as np

import dechirp as dc
from dechirp.core.compiled_kernels import use_compiled_kernels
from dechirp.simulation import phase_error
from dechirp.simulation.echo_groups import direct_echo_groups, frame_sampling_times
from dechirp.simulation.impairments.base import Impairment

use_compiled_kernels()  # warm from the first call on

warnings.simplefilter("ignore", dc.PhysicsWarning)
WAVELENGTH_M = 299_792_458.0 / 77e9


def build_highway_radar() -> dc.Radar:
    chirp = dc.Chirp(
        start_frequency_hz=76.5e9,
        slope_hz_per_s=15e12,
        adc_start_s=2e-6,
        ramp_duration_s=16e-6,
        sample_rate_hz=20e6,
        n_samples=256,
        sampling="complex",
    )
    frame = dc.Frame(
        chirp=chirp,
        n_chirps=128,
        interval_s=18e-6,
        period_s=50e-3,
        multiplexing=dc.multiplexing.Tdm(order=(0, 1, 2)),
    )
    array = dc.Array(
        tx_m=[(0, 2 * WAVELENGTH_M * k, 0) for k in range(3)],
        rx_m=[(0, WAVELENGTH_M / 2 * k, 0) for k in range(4)],
    )
    hardware = dc.Hardware(transmit_power_w=0.015, antenna_gain=20.0, noise_factor=15.0)
    return dc.Radar(frame=frame, array=array, hardware=hardware)


def build_highway_scene() -> dc.Scene:
    """Build a road with 20 vehicles, in lanes of both directions."""
    rng = np.random.default_rng(7)
    targets = []
    for number in range(20):
        is_same_direction = number % 2 == 0
        speed = float(rng.uniform(22, 38))
        kind = dc.bodies.Truck if number % 5 < 3 else (dc.bodies.Car, dc.bodies.Van)[number % 2]
        targets.append(
            dc.Target(
                name=f"vehicle-{number}",
                position_m=(
                    12.0 + 9.0 * number,
                    (-3.5 if is_same_direction else 7.0) + 3.5 * (number % 3),
                    -0.5,
                ),
                velocity_m_per_s=(speed if is_same_direction else -speed, 0, 0),
                body=kind(speed_m_per_s=speed),
            )
        )
    return dc.Scene(targets=targets, ego=dc.Ego(velocity_m_per_s=(30, 0, 0)))


def time_calls(work: Callable[[], object], n_times: int = 3) -> float:
    work()
    times_s = []
    for _ in range(n_times):
        start = perf_counter()
        work()
        times_s.append(perf_counter() - start)
    return median(times_s)


def nearest_and_farthest_scatterer(scene: dc.Scene) -> tuple[int, int]:
    """Return the indices of the nearest and the farthest scatterer."""
    range_m = np.linalg.norm(scene.scatterer_positions_m([0.0])[0], axis=-1)
    return int(range_m.argmin()), int(range_m.argmax())


def build_phase_noise_stage(scene: dc.Scene, radar: dc.Radar) -> Callable[[], None]:
    """Build the call of the phase-noise stage for one frame, without the sum of echoes."""
    (noise,) = (
        i for i in dc.impairments.AutomotiveChip().impairments(radar) if i.kind() == "phase-noise"
    )
    rng, window = np.random.default_rng(1), frame_sampling_times(radar, 0)
    parts = list(direct_echo_groups(scene, radar, 0, rng))

    def stage() -> None:
        delay_spread = phase_error.find_delay_spread(parts, window, radar)
        wide = window.widen(delay_spread.n_before, delay_spread.n_after)
        phase_rad = noise.phase_error_rad(delay_spread.phase_sample_window(wide), radar, rng)
        phase_error.apply_phase_error(echo[..., : wide.n_times], phase_rad, delay_spread, radar)

    echo = np.zeros((radar.frame.n_chirps_total, radar.array.n_rx, 512), np.complex64)
    return stage


def time_alternately(first: Callable[[], None], second: Callable[[], None]) -> tuple[float, float]:
    """Measure the median times of two jobs alternately, so that drift affects both."""
    times_s = [(time_calls(first, 1), time_calls(second, 1)) for _ in range(41)]
    return median(first_s for first_s, _ in times_s), median(second_s for _, second_s in times_s)


def main() -> None:
    radar, scene = build_highway_radar(), build_highway_scene()

    def measure_frame_s(impairments: list[Impairment]) -> float:
        return (
            time_calls(
                lambda: dc.simulate(
                    scene, radar, impairments=impairments, n_frames=options.frames, seed=1
                )
            )
            / options.frames
        )

    echoes_s = measure_frame_s([])
    times = {
        "echoes alone": echoes_s,
        "automotive-chip": measure_frame_s([dc.impairments.AutomotiveChip()]),
    }
    for impairment in dc.impairments.AutomotiveChip().impairments(radar):
        times[f"echoes and {impairment.kind()}"] = measure_frame_s([impairment])
    for name, frame_s in times.items():
        print(
            f"{name:>32} {1e3 * frame_s:7.1f} ms per frame,"
            f" {frame_s / echoes_s:5.2f} x echoes alone"
        )
    print(f"{scene.n_scatterers} scatterers, {1 / times['automotive-chip']:.1f} frames/s")
    ends = [
        scene.scatterer_positions_m([0.0])[0, index]
        for index in nearest_and_farthest_scatterer(scene)
    ]
    two_scatterers = dc.Scene(
        targets=[
            dc.Target(position_m=tuple(position_m), velocity_m_per_s=(speed, 0, 0), rcs_m2=10)
            for position_m, speed in zip(ends, (38 * -1.8, 38 * 0.2), strict=True)
        ]
    )
    all_s, two_s = time_alternately(
        build_phase_noise_stage(scene, radar), build_phase_noise_stage(two_scatterers, radar)
    )
    print(
        f"phase noise: {1e3 * all_s:.1f} ms per frame for all scatterers,"
        f" {1e3 * two_s:.1f} ms for two at the same delay spread, ratio {all_s / two_s:.3f}"
    )
    times |= {"phase noise of all": all_s, "phase noise of two": two_s}
    print(json.dumps({"threads": options.threads, "ms": {k: 1e3 * v for k, v in times.items()}}))


if __name__ == "__main__":
    main()
