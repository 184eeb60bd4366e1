"""Limits of the two answers of the witness board that fail.

own-speed        Error of the speed that is estimated from the radar's objects, against the car's
                 own speeds on CAN: of all wheels, as on the board, of the front and of the rear
                 wheels, means over time, and the speed of another message. Beside it, how far these
                 differ from one another; and the biases of standing objects; m/s RMS.
transmit-order   Strongest Doppler lines in 128 and in 256 chirps, and two ways to find the transmit
                 order of the Calterah radar, tried for each order of its published positions:
                 plane waves, fitted to the phases of all echoes at once
                 with an unknown phase a channel; and the entropy of maps of azimuth, with the
                 published phases. Beside each, the same for echoes with random phases,
                 and for simulated plane waves with phase errors of 0.3 rad.

The files are read from the folder that `DECHIRP_WITNESS_DATA` names.

    python benchmarks/witness_limits.py own-speed
    python benchmarks/witness_limits.py transmit-order
"""

import argparse
import os
import re
from itertools import permutations
from pathlib import Path

import numpy as np
import xarray as xr

import dechirp as dc
from dechirp.results.object_lists.can_mapping import read_vendor_layout
from dechirp.results.object_lists.measured_detections import objects_to_detections
from dechirp.results.object_lists.vendor_lists import assemble_vendor_list
from dechirp.tracking.forward_speed import ForwardSpeed, forward_speed
from dechirp.witnesses.comma_radar import (
    _STANDING_M_PER_S,
    _find_dbc,
    _read_frames,
    standing_object_rows,
    velocities_beyond_car,
)

STEP_S = 0.01
_WHEELS, _VEHICLE = 0xAA, 0xB4  # messages of Toyota cars, 0.01 km/h a step
_STEERING = 0x25  # 1.5 degrees a step
N_RANDOM = 20
PHASE_STD_RAD = 0.3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("limit", choices=["own-speed", "transmit-order"])
    folder = Path(os.environ["DECHIRP_WITNESS_DATA"])
    if parser.parse_args().limit == "own-speed":
        measure_own_speed(folder / "comma2k19_radar")
    else:
        measure_transmit_order(folder / "ctsai_ddma_near")


def measure_own_speed(folder: Path) -> None:
    layout = read_vendor_layout(_find_dbc(folder), "toyota-adas")
    detections = objects_to_detections(
        assemble_vendor_list(_read_frames(folder), layout),
        range_std_m=0.1,
        velocity_std_m_per_s=0.05,
        lateral_std_m=0.3,
    )
    motion = forward_speed(detections, ForwardSpeed(lag_s=0.1)).dropna("time")
    radar, radar_times_s = motion["speed"].values, motion["time"].values
    times_s, data = read_message(folder, _WHEELS)
    wheels = (data[:, 0::2] * 256.0 + data[:, 1::2]) * 0.01 / 3.6 - 67.67 / 3.6
    every = wheels.mean(axis=1)
    print(f"{times_s.size} values, every {1e3 * np.median(np.diff(times_s)):.1f} ms (median)")
    print(f"quantisation of the mean: {0.01 / 3.6 / np.sqrt(12) / 2:.4f}")
    print(f"second difference / sqrt(6): {np.std(np.diff(every, 2)) / np.sqrt(6):.4f}")
    between = np.interp(times_s[1:-1:2], times_s[::2], every[::2])
    print(f"each second value interpolated from the others: {rms(between - every[1:-1:2]):.4f}")
    vehicle_times_s, data = read_message(folder, _VEHICLE)
    vehicle = (data[:, 5] * 256.0 + data[:, 6]) * 0.01 / 3.6
    at_vehicle = np.interp(vehicle_times_s, times_s, every)
    scale = (vehicle @ at_vehicle) / (at_vehicle @ at_vehicle)
    axles = np.interp(
        radar_times_s, times_s, wheels[:, :2].mean(axis=1) - wheels[:, 2:].mean(axis=1)
    )
    print(f"front less rear wheels, where the radar has a speed: {rms(axles):.4f}")
    print(f"speed of message {_VEHICLE:#x}: {scale:.4f} times that of the wheels,")
    print(f"  after this scale beyond them: {rms(vehicle - scale * at_vehicle):.4f}")
    references = {
        "all wheels": (times_s, every),
        "front wheels": (times_s, wheels[:, :2].mean(axis=1)),
        "rear wheels": (times_s, wheels[:, 2:].mean(axis=1)),
        f"message {_VEHICLE:#x} over its scale": (vehicle_times_s, vehicle / scale),
    }
    for duration_s in (0.1, 0.25, 0.5, 1.0):
        references[f"all wheels, mean of {duration_s:g} s"] = smooth(times_s, every, duration_s)
    print(f"error of the radar's speed at {radar.size} times, and after the best scale, against")
    for name, (reference_times_s, speeds) in references.items():
        truth = np.interp(radar_times_s, reference_times_s, speeds)
        scaled = truth * (radar @ truth) / (truth @ truth)
        print(f"  {name}: {rms(radar - truth):.4f}, {rms(radar - scaled):.4f}")
    residual = velocities_beyond_car(detections, folder)
    measure_biases(detections, residual, radar_times_s)
    steering_times_s, data = read_message(folder, _STEERING)
    steps = (data[:, 0] % 16) * 256 + data[:, 1]
    steering_deg = 1.5 * np.where(steps < 2048, steps, steps - 4096)
    is_standing = np.abs(residual) < _STANDING_M_PER_S
    rows = detections.isel(detection=is_standing)
    speed, azimuth = np.interp(rows.time - 0.1, times_s, every), rows.azimuth.values
    # A car of the wheelbase 2.7 m and the steering ratio 15 turns with this rate.
    steering = np.radians(np.interp(rows.time - 0.1, steering_times_s, steering_deg))
    turn_rate = speed * steering / 15 / 2.7
    columns = {
        "offset": np.ones_like(speed),
        "scale": speed * np.cos(azimuth),
        "mounting angle": speed * np.sin(azimuth),
        "lever arm": turn_rate * np.sin(azimuth),
    }
    print(f"residuals of single objects: {rms(residual[is_standing]):.4f}; after a fit of")
    for names in (("offset",), ("mounting angle", "lever arm"), tuple(columns)):
        design = np.stack([columns[name] for name in names], axis=1)
        fit = design @ np.linalg.lstsq(design, residual[is_standing], rcond=None)[0]
        print(f"  {', '.join(names)}: {rms(residual[is_standing] - fit):.4f}")


def measure_biases(detections: xr.Dataset, residual: np.ndarray, radar_times_s: np.ndarray) -> None:
    """Print how standing objects differ, and the error of means of those seen at a time."""
    objects = standing_object_rows(detections, np.abs(residual) < _STANDING_M_PER_S)
    bias = float(np.std([residual[rows].mean() for rows in objects]))
    seen = [detections["time"].values[rows] for rows in objects]
    counts = np.array(
        [sum(np.any(np.abs(times_s - at_s) < 0.25) for times_s in seen) for at_s in radar_times_s]
    )
    counts = counts[counts >= 2]
    print(f"biases of {len(objects)} standing objects: {bias:.4f}")
    print(f"error of a mean of those within half a second: {bias * rms(counts**-0.5):.4f}")


def read_message(folder: Path, identifier: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and data (message, 8) of a message of the car's first bus."""
    address, bus, times_s, data = (
        np.load(folder / f"raw_can_{name}.npy") for name in ("address", "src", "t", "data")
    )
    rows = (address == identifier) & (bus == 0)
    # Text arrays of NumPy lack the zeros at the end.
    content = b"".join(bytes(text).ljust(8, b"\0") for text in data[rows])
    return times_s[rows], np.frombuffer(content, np.uint8).reshape(-1, 8).astype(float)


def smooth(
    times_s: np.ndarray, values: np.ndarray, duration_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return even times and the mean of the values with a Hann window."""
    even_s = np.arange(times_s[0], times_s[-1], STEP_S)
    window = np.hanning(2 * round(duration_s / STEP_S / 2) + 3)[1:-1]
    padded = np.pad(np.interp(even_s, times_s, values), window.size // 2, "edge")
    return even_s, np.convolve(padded, window / window.sum(), "valid")


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def measure_transmit_order(folder: Path) -> None:
    recording = dc.open(folder)
    array, wavelength_m = recording.radar.array, recording.radar.frame.chirp.wavelength_m
    settings = (folder / "sensor_config_init1.hxx").read_text()
    text = re.search(r"\.ant_comps = \{(.*?)\}", settings)[1]
    published = np.exp(-1j * np.radians([float(phase) for phase in text.split(",")[:16]]))
    bands = recording.radar.frame.multiplexing.sub_bands
    phases = strong_echo_phases(recording.cube.values[0], np.array(bands))
    sines = np.sin(np.radians(np.arange(-75, 75.5, 0.5)))
    transmit, receive = (
        np.exp(2j * np.pi / wavelength_m * np.outer(sines, np.array(positions_m)[:, 1]))
        for positions_m in (array.tx_m, array.rx_m)
    )
    # Two transmitters are at one point: their exchange changes nothing.
    twins = [i for i, place in enumerate(array.tx_m) if array.tx_m.count(place) > 1]
    orders = [
        order for order in permutations(range(4)) if order.index(twins[0]) < order.index(twins[1])
    ]
    for n_chirps in (128, 256):
        print_strongest_lines(recording.cube.values[0].transpose(1, 0, 2), n_chirps, n_chirps // 32)
    print(f"{len(phases)} echoes in {len(bands)} sub-bands and {array.n_rx} receivers")
    rng = np.random.default_rng(1)
    random = [np.exp(2j * np.pi * rng.random(phases.shape)) for _ in range(N_RANDOM)]
    halves = phases[::2], phases[1::2]
    true_order = [3, 0, 1, 2]
    direction = rng.integers(60, sines.size - 60, len(phases))
    waves = transmit[direction][:, true_order, None] * receive[direction][:, None, :]
    errors = rng.normal(0, PHASE_STD_RAD, waves.shape)
    simulated = waves * published.conj().reshape(4, 4)[true_order] * np.exp(1j * errors)

    def shares(echoes: np.ndarray) -> np.ndarray:
        return np.array([fit_share(echoes, transmit[:, order], receive, rng) for order in orders])

    def negative_entropies(echoes: np.ndarray) -> np.ndarray:
        # The settings do not state the sign of the phases. That of directions changes nothing.
        by_sign = [
            -angle_entropy(echoes * factors.reshape(4, 4)[list(order)], transmit[:, order], receive)
            for factors in (published, published.conj())
            for order in orders
        ]
        return np.max(np.reshape(by_sign, (-1, len(orders))), axis=0)

    for name, score in (
        ("share of the power that plane waves explain", shares),
        ("entropy of the maps, negative (nats)", negative_entropies),
    ):
        scores, chance = score(phases), np.sort([score(echoes) for echoes in random])
        ranked = np.sort(scores)[::-1]
        print(f"{name}: best order {ranked[0]:.4f}, next {ranked[1]:.4f}, last {ranked[-1]:.4f}")
        print(
            f"  random phases, best order: {chance[:, -1].min():.4f} to {chance[:, -1].max():.4f}"
        )
        lead = chance[:, -1] - chance[:, -2]
        print(f"  lead of the best: {ranked[0] - ranked[1]:.5f}; random: up to {lead.max():.5f}")
        best = [orders[int(score(half).argmax())] for half in halves]
        print(f"  order of all echoes {orders[int(scores.argmax())]}, of either half {best}")
        ranked = np.sort(score(simulated))[::-1]
        lead = ranked[0] - ranked[1]
        order = orders[int(score(simulated).argmax())]
        print(f"  simulated plane waves of order {tuple(true_order)}: {order}, {ranked[0]:.4f}")
        print(f"  lead of their best order: {lead:.5f}")


def print_strongest_lines(samples: np.ndarray, n_chirps: int, n_lines: int) -> None:
    """Print the strongest Doppler lines of all ranges, with the samples divided into chirps."""
    chirps = samples.reshape(len(samples), n_chirps, -1)
    ranges = np.fft.rfft(chirps * np.hanning(chirps.shape[2]), axis=2)
    spectrum = np.fft.fft(ranges * np.hanning(n_chirps)[:, None], axis=1)
    power = np.sum(np.abs(spectrum) ** 2, axis=(0, 2))
    is_peak = (power > np.roll(power, 1)) & (power >= np.roll(power, -1))
    peaks = sorted(np.flatnonzero(is_peak).tolist(), key=lambda line: -power[line])
    span, gap = (
        10 * np.log10(power[peaks[a]] / power[peaks[b]])
        for a, b in ((0, n_lines - 1), (n_lines - 1, n_lines))
    )
    print(f"{n_chirps} chirps: Doppler lines {sorted(peaks[:n_lines])} within {span:.1f} dB,")
    print(f"  {gap:.1f} dB above all others")


def strong_echo_phases(chirps: np.ndarray, bands: np.ndarray) -> np.ndarray:
    """Return phases (echo, band, rx) of static echoes 26 dB over the median of the spectrum."""
    n_chirps, _, n_samples = chirps.shape
    windowed = chirps * np.blackman(n_samples + 2)[1:-1]
    ranges = np.fft.rfft(windowed, axis=2) * np.hanning(n_chirps + 2)[1:-1, None, None]
    spectrum = np.fft.fft(ranges, axis=0)
    lines = spectrum[bands * (n_chirps // 8)]  # (band, rx, range)
    floor = len(bands) * np.median(np.abs(spectrum) ** 2, axis=(0, 2))
    power = np.mean(np.sum(np.abs(lines) ** 2, axis=0) / floor[:, None], axis=0)
    is_peak = (power[1:-1] > power[:-2]) & (power[1:-1] > power[2:]) & (power[1:-1] > 100)
    cells = np.flatnonzero(is_peak) + 1
    echoes = lines[:, :, cells[cells >= 8]].transpose(2, 0, 1)
    return np.asarray(echoes / np.abs(echoes))


def fit_share(
    echoes: np.ndarray, transmit: np.ndarray, receive: np.ndarray, rng: np.random.Generator
) -> float:
    """Return the share of the power that a plane wave an echo explains, for one order.

    The phases of the channels are common to all echoes, and fitted with the directions in turns,
    from six starts.
    """
    waves = (transmit[:, :, None] * receive[:, None, :]).reshape(len(receive), -1)
    channels = echoes.reshape(len(echoes), -1)
    best = 0.0
    for _ in range(6):
        phases = np.exp(2j * np.pi * rng.random(channels.shape[1]))
        for _ in range(20):
            beams = (channels * phases.conj()) @ waves.conj().T
            direction = np.abs(beams).argmax(axis=1)
            beam = beams[np.arange(len(echoes)), direction]
            aligned = channels * waves.conj()[direction] * beam.conj()[:, None]
            phases = np.exp(1j * np.angle(aligned.sum(axis=0)))
        best = max(best, float(np.mean(np.abs(beam) ** 2)) / channels.shape[1] ** 2)
    return best


def angle_entropy(echoes: np.ndarray, transmit: np.ndarray, receive: np.ndarray) -> float:
    """Return the mean entropy of the normalised power over azimuth (nats)."""
    beams = np.einsum("db,dr,cbr->cd", transmit.conj(), receive.conj(), echoes)
    power = np.abs(beams) ** 2
    share = power / power.sum(axis=1, keepdims=True)
    return float(-np.sum(share * np.log(share), axis=1).mean())


if __name__ == "__main__":
    main()
