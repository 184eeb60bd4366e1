"""Simulated frames per second of a highway scene, with hardware impairments.

Twenty cars, vans and trucks of some 3,000 scatterers, wheels turning, before a radar of three
transmitters in turns and four receivers, 128 chirps of each and 256 samples; `automotive-chip`; 20
frames. Beside it what each stage adds: echoes alone, and each impairment alone, over echoes
alone in the same run; and the oscillator's stage for all scatterers against that for two as far
apart.

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
parser.add_argument("--threads", type=int, default=2)
parser.add_argument("--frames", type=int, default=20)
options = parser.parse_args()
for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[pool] = "1"
os.environ["NUMBA_NUM_THREADS"] = str(options.threads)

import numpy as np

import dechirp as dc
from dechirp.simulation import phase_error
from dechirp.simulation.echo_groups import direct_echo_groups, sample_window
from dechirp.simulation.impairments.base import Impairment

warnings.simplefilter("ignore", dc.PhysicsWarning)
WAVELENGTH_M = 299_792_458.0 / 77e9


def highway_radar() -> dc.Radar:
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


def highway_scene() -> dc.Scene:
    """Three lanes each way, one vehicle every few tens of metres."""
    rng = np.random.default_rng(7)
    targets = []
    for number in range(20):
        ahead = number % 2 == 0
        speed = float(rng.uniform(22, 38))
        kind = dc.bodies.Truck if number % 5 < 3 else (dc.bodies.Car, dc.bodies.Van)[number % 2]
        targets.append(
            dc.Target(
                name=f"vehicle-{number}",
                position_m=(
                    12.0 + 9.0 * number,
                    (-3.5 if ahead else 7.0) + 3.5 * (number % 3),
                    -0.5,
                ),
                velocity_m_per_s=(speed if ahead else -speed, 0, 0),
                body=kind(speed_m_per_s=speed),
            )
        )
    return dc.Scene(targets=targets, ego=dc.Ego(velocity_m_per_s=(30, 0, 0)))


def time_calls(work: Callable[[], object], n_times: int = 3) -> float:
    work()
    took = []
    for _ in range(n_times):
        began = perf_counter()
        work()
        took.append(perf_counter() - began)
    return median(took)


def nearest_and_farthest(scene: dc.Scene) -> tuple[int, int]:
    """Return the indices of the nearest and the farthest scatterer."""
    range_m = np.linalg.norm(scene.scatterer_positions_m([0.0])[0], axis=-1)
    return int(range_m.argmin()), int(range_m.argmax())


def build_phase_noise_stage(scene: dc.Scene, radar: dc.Radar) -> Callable[[], None]:
    """Build the phase-noise stage of one frame, without the sum of echoes."""
    (noise,) = (
        i for i in dc.impairments.AutomotiveChip().impairments(radar) if i.kind() == "phase-noise"
    )
    rng, window = np.random.default_rng(1), sample_window(radar, 0)
    parts = list(direct_echo_groups(scene, radar, 0, rng))

    def stage() -> None:
        reach = phase_error.find_delay_spread(parts, window, radar)
        wide = window.widen(reach.n_before, reach.n_after)
        phase_rad = noise.phase_error_rad(reach.phase_sample_window(wide), radar, rng)
        phase_error.apply_phase_error(echo[..., : wide.n_times], phase_rad, reach, radar)

    echo = np.zeros((radar.frame.n_chirps_total, radar.array.n_rx, 512), np.complex64)
    return stage


def time_alternately(first: Callable[[], None], second: Callable[[], None]) -> tuple[float, float]:
    """Measure the median times of two jobs alternately, so that drift affects both."""
    times_s = [(time_calls(first, 1), time_calls(second, 1)) for _ in range(41)]
    return median(of_one for of_one, _ in times_s), median(of_other for _, of_other in times_s)


def main() -> None:
    radar, scene = highway_radar(), highway_scene()

    def frames_s(impairments: list[Impairment]) -> float:
        return (
            time_calls(
                lambda: dc.simulate(
                    scene, radar, impairments=impairments, n_frames=options.frames, seed=1
                )
            )
            / options.frames
        )

    alone_s = frames_s([])
    times = {
        "echoes alone": alone_s,
        "automotive-chip": frames_s([dc.impairments.AutomotiveChip()]),
    }
    for impairment in dc.impairments.AutomotiveChip().impairments(radar):
        times[f"echoes and {impairment.kind()}"] = frames_s([impairment])
    for name, took_s in times.items():
        print(f"{name:>32} {1e3 * took_s:7.1f} ms a frame, {took_s / alone_s:5.2f} x echoes alone")
    print(f"{scene.n_scatterers} scatterers, {1 / times['automotive-chip']:.1f} frames/s")
    ends = [scene.scatterer_positions_m([0.0])[0, place] for place in nearest_and_farthest(scene)]
    two = dc.Scene(
        targets=[
            dc.Target(position_m=tuple(at_m), velocity_m_per_s=(38 * way, 0, 0), rcs_m2=10)
            for at_m, way in zip(ends, (-1.8, 0.2), strict=True)
        ]
    )
    of_all_s, of_two_s = time_alternately(
        build_phase_noise_stage(scene, radar), build_phase_noise_stage(two, radar)
    )
    print(
        f"phase noise: {1e3 * of_all_s:.1f} ms a frame of all scatterers, {1e3 * of_two_s:.1f} of"
        f" two as far apart: {of_all_s / of_two_s:.3f}"
    )
    times |= {"phase noise of all": of_all_s, "phase noise of two": of_two_s}
    print(json.dumps({"threads": options.threads, "ms": {k: 1e3 * v for k, v in times.items()}}))


if __name__ == "__main__":
    main()
