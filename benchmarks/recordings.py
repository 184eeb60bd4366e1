"""Opening time, decoding speed and memory of recordings.

decode   Time to decode a DCA1000 capture of 128 MiB in the file cache, with two and four lanes, to
         a new complex64 cube, over `numpy.fromfile` of the same file; at most 4. A further ratio
         is for decoding with strided NumPy assignments.
text     Time to open and decode Calterah text of 23 MB with its radar, over the conversion of its
         numbers with `numpy.fromstring`; at most 4. The same for uRAD text of 4 MB, a line of which
         ends with a time: over the conversion line by line, without a check of each number; at
         most 4. The same for slow time in CSV of 6 MB: over `numpy.fromstring`; at most 4.
formats  The capture of 128 MiB in other formats, opened and decoded, over `numpy.fromfile` of the
         same bytes; at most 4 where the guide gives no limit. WAV files of 64 MiB have noise.
sensors  Files of other programs. Over `numpy.fromfile` of the same bytes: a DCA1000 capture of
         49 MB with its mmWave Studio JSON, 16 sweeps a frame of Acconeer (HDF5, 31 MB), and ROS 1
         bags of a million points, 250 and 5,000 a message. Over `h5py`: Acconeer. Over the frames
         alone with `python-can`: 50,000 objects of a Delphi ESR on CAN (BLF). The capture and the
         DBC are those of the witness board and need `DECHIRP_WITNESS_DATA`.
open     Time to open a capture of 4 GB and decode one frame, s; at most 0.3. A second figure is for
         a network capture (pcap) of 1 GB, which requires reading each packet.
memory   Growth of the resident memory of a process that reads a capture, an .npy file or a network
         capture of 1 GB each, frame by frame; MB in addition to three frames, at most 200.

Compiled code is cached. Ratios are medians of nine pairs, measured alternately (A B A B).

    python benchmarks/recordings.py                 all groups
    python benchmarks/recordings.py text sensors    two of them
"""

import argparse
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import wave
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from time import perf_counter

for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[pool] = "1"

import can
import h5py
import numpy as np
import xarray as xr
from rosbags import rosbag1
from rosbags.typesys import Stores, get_typestore

import dechirp as dc
from dechirp.results.object_lists.list_columns import build_object_list

ACCONEER_ENTRY = "sessions/session_0/group_0/entry_0"
N_RX, N_CHIRPS, N_SAMPLES = 4, 128, 256
FRAME_BYTES = N_RX * N_CHIRPS * N_SAMPLES * 4
CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    ramp_duration_s=30e-6,
    sample_rate_hz=10e6,
    n_samples=N_SAMPLES,
    sampling="complex",
)
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=N_CHIRPS, interval_s=40e-6),
    array=dc.Array(rx_m=tuple((0.0, 0.002 * n, 0.0) for n in range(N_RX))),
)
DCA1000_OPTIONS = {"device": "xwr1642", "iq": "iq", "format": "dca1000"}
GROUPS = ("decode", "text", "formats", "sensors", "open", "memory")
BARS = {
    **{"decode_two_lanes": 4, "decode_four_lanes": 4, "open_4_gb_s": 0.3},
    **{"memory_dca1000_mb": 200, "memory_npy_mb": 200, "memory_pcap_mb": 200},
    **{f"format_{name}": 4 for name in ("bare.npy", "bare.npz", "x.npz", "x.h5", "x.zarr")},
    **{"text_urad": 4, "text_calterah": 4, "text_slow_time": 4},
}
MEMORY = """
import sys, psutil, threading, time
import dechirp as dc
sys.path.insert(0, {here!r})
from recordings import RADAR
for _ in dc.open({small!r}, radar=RADAR, **{options!r}).frames():  # imports and compiles
    pass
process, peak, finished = psutil.Process(), 0, False
def watch():
    global peak
    while not finished:
        peak = max(peak, process.memory_info().rss)
        time.sleep(0.002)
initial = process.memory_info().rss
watcher = threading.Thread(target=watch)
watcher.start()
for _ in dc.open({large!r}, radar=RADAR, **{options!r}).frames():
    pass
finished = True
watcher.join()
print(peak - initial)
"""


def time_call(call: Callable[[], object]) -> float:
    """Measure the time of one call, without the release of its result."""
    start = perf_counter()
    result = call()
    elapsed_s = perf_counter() - start
    del result
    return elapsed_s


def measure_ratio(ours: Callable[[], object], reference: Callable[[], object]) -> float:
    """Measure the median ratio of nine alternate pairs of calls, after one warm-up pair."""
    ours(), reference()
    return median(time_call(ours) / time_call(reference) for _ in range(9))


def decode_with_strides(file: Path) -> np.ndarray:
    """De-interleave two lanes with strided NumPy assignments."""
    groups = np.memmap(file, "<i2", "r").reshape(-1, 2, 2)
    samples = np.empty((len(groups), 2), np.complex64)
    samples.real, samples.imag = groups[:, 0], groups[:, 1]
    samples /= 32768
    return samples


def measure_text_ratios(folder: Path, rng: np.random.Generator) -> dict[str, float]:
    """Measure the readers of text over the conversion of its numbers."""
    urad, calterah = folder / "IQ.txt", folder / "rx0.txt"
    codes = rng.integers(1000, 4096, (1024, 800))
    lines = [f"{' '.join(map(str, row))} {1.7e9 + n / 25:.3f}\n" for n, row in enumerate(codes)]
    urad.write_text("".join(lines))
    words = rng.integers(2**31, 2**32, 2**21)
    calterah.write_text(",".join(map(str, words)))
    (folder / "radar.hxx").touch()  # by which the format is recognised
    slow_time = folder / "slow_time.csv"
    rows = np.column_stack([np.arange(200_000) / 20, rng.normal(size=(200_000, 2))])
    np.savetxt(slow_time, rows, "%.9g", delimiter=",", header="time,I,Q", comments="")
    real = dc.Radar(frame=replace(RADAR.frame, chirp=replace(CHIRP, sampling="real")))
    return {
        "text_urad": measure_ratio(
            lambda: dc.open(urad, format="urad").cube,
            lambda: [
                np.fromstring(line.rsplit(b" ", 1)[0], np.int64, sep=" ")
                for line in urad.read_bytes().splitlines()
            ],
        ),
        "text_calterah": measure_ratio(
            lambda: dc.open(calterah, format="calterah", radar=real).cube,
            lambda: np.fromstring(calterah.read_bytes(), np.int64, sep=","),
        ),
        "text_slow_time": measure_ratio(
            lambda: dc.slow_time_files.read_slow_time(slow_time, wavelength_m=0.005),
            lambda: np.fromstring(
                slow_time.read_bytes().partition(b"\n")[2].replace(b"\n", b","), sep=","
            ),
        ),
    }


def measure_format_ratios(
    folder: Path, capture: Path, rng: np.random.Generator
) -> dict[str, float]:
    """Measure the readers of other formats over the time to read the bytes of their files."""
    recording = dc.open(capture, radar=RADAR, device="xwr1642", iq="iq", format="dca1000")
    axes: dict[str, object] = {"radar": RADAR, "axes": "frame,chirp,rx,sample,iq"}
    numbers = np.fromfile(capture, np.int16).reshape(-1, N_CHIRPS, N_RX, N_SAMPLES, 2)
    np.save(folder / "bare.npy", numbers)
    np.savez(folder / "bare.npz", numbers)
    numbers.tofile(folder / "x.cs16")
    options: dict[str, dict[str, object]] = {
        "bare.npy": axes,
        "bare.npz": axes,
        "x.cs16": axes | {"axes": "frame,chirp,rx,sample"},
    }
    for name in ("x.npz", "x.h5", "x.mat", "x.zarr", "x.sigmf-meta"):
        dc.write(recording, folder / name)
        options[name] = {}
    write_network_capture(folder / "short.pcap", 2**26)
    options["short.pcap"] = {"radar": RADAR, "iq": "iq"}
    real = dc.Radar(frame=replace(RADAR.frame, chirp=replace(CHIRP, sampling="real")))
    ramps = np.where(np.arange(2**24) % 400 < 380, -9000, 9000)  # inverted sync
    for name, channels in (
        ("continuous.wav", (rng.integers(-9000, 9000, 2**25),)),
        ("sync.wav", (rng.integers(-9000, 9000, 2**24), ramps)),
    ):
        with wave.open(str(folder / name), "wb") as file:
            file.setparams((len(channels), 2, round(CHIRP.sample_rate_hz), 0, "NONE", ""))
            file.writeframes(np.stack(channels, axis=-1).astype("<i2").tobytes())
        options[name] = {"radar": real}
    ratios = {}
    for name, named in options.items():
        path = folder / name.replace("meta", "data")
        files = [part for part in (path, *path.rglob("*")) if part.is_file()]
        ratios[f"format_{name}"] = measure_ratio(
            lambda name=name, named=named: dc.open(folder / name, **named).cube,
            lambda files=files: [np.fromfile(file, np.uint8) for file in files],
        )
    return ratios


def measure_sensor_ratios(folder: Path, rng: np.random.Generator) -> dict[str, float]:
    """Measure the readers of files that other programs record, over programs that read the same."""
    acconeer = folder / "acconeer.h5"
    write_acconeer(acconeer, rng)
    bags = {n: folder / f"points_{n}.bag" for n in (250, 5000)}
    for n_points, bag in bags.items():
        write_ros1_bag(bag, n_points, 1_000_000 // n_points, rng)

    def read_with_h5py() -> object:
        with h5py.File(acconeer) as file:
            return file[f"{ACCONEER_ENTRY}/result/frame"][()]

    def read_acconeer() -> object:
        return dc.slow_time_files.read_slow_time(acconeer)

    ratios = {
        "sensor_acconeer": measure_ratio(read_acconeer, lambda: np.fromfile(acconeer, np.uint8)),
        "sensor_acconeer_over_h5py": measure_ratio(read_acconeer, read_with_h5py),
    }
    for n_points, bag in bags.items():
        ratios[f"sensor_ros1_bag_{n_points}"] = measure_ratio(
            lambda bag=bag: dc.open(bag).points, lambda bag=bag: np.fromfile(bag, np.uint8)
        )
    witnesses = os.environ.get("DECHIRP_WITNESS_DATA")
    if witnesses is not None:
        captured = folder / "iwr1843"  # alone: settings are searched beside a capture
        captured.mkdir()
        capture = copy_mmwave_studio_capture(Path(witnesses) / "iwr1843_reflectors", captured)
        ratios["sensor_iwr1843_json"] = measure_ratio(
            lambda: dc.open(capture).cube, lambda: np.fromfile(capture, np.int16)
        )
        log, vendor = folder / "esr.blf", {"mapping": "delphi-esr"}
        vendor["dbc"] = str(Path(witnesses) / "car_dbc" / "ESR.dbc")
        dc.object_lists.write_can_log(draw_objects(1000, 50, rng), log, **vendor)
        ratios["sensor_vendor_can"] = measure_ratio(
            lambda: dc.object_lists.read_can_log(log, **vendor), lambda: list(can.BLFReader(log))
        )
    return ratios


def write_acconeer(file: Path, rng: np.random.Generator) -> None:
    """Write frames of 16 sweeps as Acconeer's Exploration Tool does for an A121."""
    frames = np.zeros((2000, 16, 240), [("real", "<i2"), ("imag", "<i2")])
    for name in ("real", "imag"):
        frames[name] = rng.integers(-2000, 2000, frames.shape)
    subsweeps = [{"start_point": 100, "num_points": 240, "step_length": 1}]
    with h5py.File(file, "w") as out:
        out[f"{ACCONEER_ENTRY}/result/frame"] = frames
        out[f"{ACCONEER_ENTRY}/result/tick"] = 50_000 * np.arange(len(frames))
        out[f"{ACCONEER_ENTRY}/sensor_id"] = 1
        out[f"{ACCONEER_ENTRY}/metadata"] = json.dumps({"base_step_length_m": 0.0025})
        out["server_info"] = json.dumps({"ticks_per_second": 1_000_000})
        out["sessions/session_0/session_config"] = json.dumps(
            {"groups": [{"1": {"subsweeps": subsweeps}}]}
        )


def write_ros1_bag(file: Path, n_points: int, n_messages: int, rng: np.random.Generator) -> None:
    """Write point clouds of five float32 fields."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types, kind = store.types, "sensor_msgs/msg/PointCloud2"
    fields = [
        types["sensor_msgs/msg/PointField"](name=name, offset=4 * n, datatype=7, count=1)
        for n, name in enumerate(("x", "y", "z", "velocity", "snr"))
    ]
    with rosbag1.Writer(file) as bag:
        connection = bag.add_connection("/radar", kind, typestore=store)
        for number in range(n_messages):
            points = rng.uniform(1, 40, (n_points, 5)).astype(np.float32)
            stamp = types["builtin_interfaces/msg/Time"](sec=1600 + number, nanosec=0)
            cloud = types[kind](
                header=types["std_msgs/msg/Header"](seq=number, stamp=stamp, frame_id="front"),
                height=1,
                width=n_points,
                fields=fields,
                is_bigendian=False,
                point_step=20,
                row_step=points.nbytes,
                data=points.view(np.uint8).ravel(),
                is_dense=True,
            )
            bag.write(connection, (1600 + number) * 10**9, store.serialize_ros1(cloud, kind))


def copy_mmwave_studio_capture(source: Path, folder: Path) -> Path:
    """Repeat the frames of a capture with its mmWave Studio JSON a hundred times."""
    capture = folder / "1_Raw_0.bin"
    capture.write_bytes((source / capture.name).read_bytes() * 100)
    shutil.copy(source / "chirp1.setup.json", folder)
    text = (source / "chirp1.mmwave.json").read_text()
    (folder / "chirp1.mmwave.json").write_text(
        text.replace('"numFrames": 20,', '"numFrames": 2000,')
    )
    return capture


def draw_objects(n_lists: int, n_objects: int, rng: np.random.Generator) -> xr.Dataset:
    """Draw lists of objects with radial velocities, 50 ms apart."""
    n_total, times_s = n_lists * n_objects, np.arange(n_lists) * 0.05
    x_m, y_m = rng.uniform(5, 90, n_total), rng.uniform(-20, 20, n_total)
    columns = {
        "frame": np.repeat(np.arange(n_lists), n_objects),
        "time": np.repeat(times_s, n_objects),
        "number": np.tile(np.arange(1, n_objects + 1), n_lists),
        "status": np.full(n_total, "confirmed"),
        "x": x_m,
        "y": y_m,
        "vx": 0.2 * x_m,
        "vy": 0.2 * y_m,
    }
    return build_object_list(columns, np.arange(n_lists), times_s)


def write_network_capture(file: Path, n_bytes: int) -> None:
    """Write a pcap file of DCA1000 packets with zeros."""
    with file.open("wb") as out:
        out.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1))
        for number, start in enumerate(range(0, n_bytes, 1456), start=1):
            payload = bytes(min(1456, n_bytes - start))
            udp = struct.pack(">HHHH", 4096, 4098, 18 + len(payload), 0)
            ip = struct.pack(">BBHHHBBHII", 69, 0, 38 + len(payload), 0, 0, 64, 17, 0, 0, 0)
            packet = bytes(12) + b"\x08\x00" + ip + udp + struct.pack("<I", number)
            packet += start.to_bytes(6, "little") + payload
            out.write(struct.pack("<IIII", 0, 0, len(packet), len(packet)) + packet)


def measure_memory_mb(folder: Path, small: Path, large: Path, options: dict[str, object]) -> float:
    """Measure the growth of resident memory after a small file was read, minus three frames."""
    script = MEMORY.format(
        here=str(Path(__file__).parent), small=str(small), large=str(large), options=options
    )
    process = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, check=True, capture_output=True, text=True
    )
    return (int(process.stdout) - 3 * 2 * FRAME_BYTES) / 1e6


def measure_decoding(capture: Path) -> dict[str, float]:
    results = {}
    for lanes, device in (("two", "xwr1642"), ("four", "xwr1443")):
        options = {"radar": RADAR, "device": device, "iq": "iq", "format": "dca1000"}
        results[f"decode_{lanes}_lanes"] = measure_ratio(
            lambda options=options: dc.open(capture, **options).cube,
            lambda: np.fromfile(capture, np.int16),
        )
    results["decode_with_strides"] = measure_ratio(
        lambda: decode_with_strides(capture), lambda: np.fromfile(capture, np.int16)
    )
    return results


def measure_opening_s(folder: Path) -> dict[str, float]:
    large = folder / "large.bin"
    with large.open("wb") as out:
        out.truncate(4000 * FRAME_BYTES * 2)  # 4.2 GB, sparse

    def decode_one_frame() -> object:
        return dc.open(large, radar=RADAR, frames=(3999, 4000), **DCA1000_OPTIONS).cube

    decode_one_frame()
    results = {"open_4_gb_s": median(time_call(decode_one_frame) for _ in range(5))}
    large.unlink()
    packets = folder / "x.pcap"
    write_network_capture(packets, 2**30)
    results["open_1_gb_pcap_s"] = time_call(
        lambda: dc.open(packets, radar=RADAR, frames=(900, 901)).cube
    )
    packets.unlink()
    return results


def measure_memory_growths_mb(folder: Path, capture: Path) -> dict[str, float]:
    small, large = folder / "small.bin", folder / "large.bin"
    with capture.open("rb") as file:
        small.write_bytes(file.read(2 * FRAME_BYTES))
    with large.open("wb") as out:
        out.truncate(2048 * FRAME_BYTES)
    results = {"memory_dca1000_mb": measure_memory_mb(folder, small, large, DCA1000_OPTIONS)}
    array = np.lib.format.open_memmap(
        folder / "large.npy", "w+", np.int16, (2048, N_CHIRPS, N_RX, N_SAMPLES, 2)
    )
    array[:2] = 1
    np.save(folder / "small.npy", array[:2])
    del array
    results["memory_npy_mb"] = measure_memory_mb(
        folder,
        folder / "small.npy",
        folder / "large.npy",
        {"axes": "frame,chirp,rx,sample,iq"},
    )
    write_network_capture(folder / "x.pcap", 2**30)
    write_network_capture(folder / "small.pcap", 2 * FRAME_BYTES)
    results["memory_pcap_mb"] = measure_memory_mb(
        folder, folder / "small.pcap", folder / "x.pcap", {"iq": "iq"}
    )
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"of {', '.join(GROUPS)}")
    groups = parser.parse_args().groups or list(GROUPS)
    if unknown := set(groups) - set(GROUPS):
        parser.error(f"{', '.join(sorted(unknown))}: unknown; expected {', '.join(GROUPS)}")
    rng = np.random.default_rng(0)
    results: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        capture = folder / "x.bin"
        if {"decode", "formats", "memory"} & set(groups):
            rng.integers(-2000, 2000, 2**26, dtype=np.int16).tofile(capture)
        measurements: dict[str, Callable[[], dict[str, float]]] = {
            "decode": lambda: measure_decoding(capture),
            "text": lambda: measure_text_ratios(folder, rng),
            "formats": lambda: measure_format_ratios(folder, capture, rng),
            "sensors": lambda: measure_sensor_ratios(folder, rng),
            "open": lambda: measure_opening_s(folder),
            "memory": lambda: measure_memory_growths_mb(folder, capture),
        }
        for group in groups:
            results |= measurements[group]()
    bars = {name: bar for name, bar in BARS.items() if name in results}
    print(json.dumps({"measured": results, "at_most": bars}, indent=2))
    raise SystemExit(1 if any(results[name] > bar for name, bar in bars.items()) else 0)


if __name__ == "__main__":
    main()
