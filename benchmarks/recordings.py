"""Opening time, decoding speed and memory of recordings.

decode   complex64 cube, fresh, of a DCA1000 capture of 128 MiB in the file cache, two lanes
         and four, over `numpy.fromfile` of the same file; at most 4. Beside it, the same with
         NumPy's strides alone.
open     opening a capture of 4 GB and decoding one frame of it, s; at most 0.3. A second
         figure is for a network capture (pcap) of 1 GB, every packet of which is examined.
memory   growth of the resident memory of a process that reads a capture of 1 GB frame by
         frame, as large an .npy, or as large a network capture, in MB over three frames; at
         most 200.

Compiled code is cached; ratios are medians of nine pairs of turns A B A B.

    python benchmarks/recordings.py
"""

import json
import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter

for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[pool] = "1"

import numpy as np

import dechirp as dc

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
MEMORY = """
import sys, psutil, threading, time
import dechirp as dc
sys.path.insert(0, {here!r})
from recordings import RADAR
for _ in dc.open({small!r}, radar=RADAR, **{options!r}).frames():  # compiles, imports
    pass
me, most, done = psutil.Process(), 0, False
def watch():
    global most
    while not done:
        most = max(most, me.memory_info().rss)
        time.sleep(0.002)
before = me.memory_info().rss
watcher = threading.Thread(target=watch)
watcher.start()
for _ in dc.open({large!r}, radar=RADAR, **{options!r}).frames():
    pass
done = True
watcher.join()
print(most - before)
"""


def time_call(call: Callable[[], object]) -> float:
    """Time of one call; what it returns is freed after the clock has stopped."""
    start = perf_counter()
    result = call()
    elapsed_s = perf_counter() - start
    del result
    return elapsed_s


def measure_ratio(ours: Callable[[], object], other: Callable[[], object]) -> float:
    """Median of the ratios of nine pairs of turns, after one that is not counted."""
    ours(), other()
    return median(time_call(ours) / time_call(other) for _ in range(9))


def decode_with_strides(file: Path) -> np.ndarray:
    """De-interleave two lanes as one writes it with NumPy."""
    groups = np.memmap(file, "<i2", "r").reshape(-1, 2, 2)
    samples = np.empty((len(groups), 2), np.complex64)
    samples.real, samples.imag = groups[:, 0], groups[:, 1]
    samples /= 32768
    return samples


def write_network_capture(file: Path, n_bytes: int) -> None:
    """Write packets of zeros, as a DCA1000 sends them."""
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
    """Peak resident memory over what the import and a small file took, less three frames."""
    script = MEMORY.format(
        here=str(Path(__file__).parent), small=str(small), large=str(large), options=options
    )
    process = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, check=True, capture_output=True, text=True
    )
    return (int(process.stdout) - 3 * 2 * FRAME_BYTES) / 1e6


def main() -> None:
    rng = np.random.default_rng(0)
    results: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        capture, small, large = folder / "x.bin", folder / "small.bin", folder / "large.bin"
        rng.integers(-2000, 2000, 2**26, dtype=np.int16).tofile(capture)
        small.write_bytes(capture.read_bytes()[: 2 * FRAME_BYTES])
        for lanes, device in (("two", "xwr1642"), ("four", "xwr1443")):
            options = {"radar": RADAR, "device": device, "iq": "iq", "format": "dca1000"}
            results[f"decode_{lanes}_lanes"] = measure_ratio(
                lambda options=options: dc.open(capture, **options).cube,
                lambda: np.fromfile(capture, np.int16),
            )
        results["decode_with_strides"] = measure_ratio(
            lambda: decode_with_strides(capture), lambda: np.fromfile(capture, np.int16)
        )
        options = {"device": "xwr1642", "iq": "iq", "format": "dca1000"}
        with large.open("wb") as out:
            out.truncate(4000 * FRAME_BYTES * 2)  # 4.2 GB, without taking the disk

        def one_frame() -> object:
            return dc.open(large, radar=RADAR, frames=(3999, 4000), **options).cube

        one_frame()
        results["open_4_gb_s"] = median(time_call(one_frame) for _ in range(5))
        with large.open("wb") as out:
            out.truncate(2048 * FRAME_BYTES)
        results["memory_dca1000_mb"] = measure_memory_mb(folder, small, large, options)
        array = np.lib.format.open_memmap(
            folder / "large.npy", "w+", np.int16, (2048, N_CHIRPS, N_RX, N_SAMPLES, 2)
        )
        array[:2] = 1
        np.save(folder / "small.npy", array[:2])
        del array
        options = {"axes": "frame,chirp,rx,sample,iq"}
        results["memory_npy_mb"] = measure_memory_mb(
            folder, folder / "small.npy", folder / "large.npy", options
        )
        write_network_capture(folder / "x.pcap", 2**30)
        write_network_capture(folder / "small.pcap", 2 * FRAME_BYTES)
        results["memory_pcap_mb"] = measure_memory_mb(
            folder, folder / "small.pcap", folder / "x.pcap", {"iq": "iq"}
        )
        results["open_1_gb_pcap_s"] = time_call(
            lambda: dc.open(folder / "x.pcap", radar=RADAR, frames=(900, 901)).cube
        )
    bars = {"decode_two_lanes": 4, "decode_four_lanes": 4, "open_4_gb_s": 0.3}
    bars |= {"memory_dca1000_mb": 200, "memory_npy_mb": 200, "memory_pcap_mb": 200}
    print(json.dumps({"measured": results, "at_most": bars}, indent=2))
    raise SystemExit(1 if any(results[name] > most for name, most in bars.items()) else 0)


if __name__ == "__main__":
    main()
