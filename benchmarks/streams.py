"""Packet loss and processor load of a DCA1000 stream at full rate on loopback.

The stream has 20 frames/s of 128 chirps x 8 channels x 256 complex int16 samples: 1 MiB per frame,
21 MB/s, 14,400 packets/s. The channels are a TDM array of two transmitters and four receivers, so a
frame has 256 chirps. Another process on the same machine sends groups of 16 packets and uses most
of one core. The cases are:

taken      Frames are received and discarded.
detected   Each frame is processed by `detect`: maps, detections, directions.
held       At every 15th frame, Python code holds the interpreter lock for 0.5 s.

For each case the script prints the frames per second, the lost packets, the frames with gaps, and
the load of this process as a fraction of one core (receiving, decoding and processing).

    python benchmarks/streams.py [SECONDS]
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[pool] = "1"

import numpy as np
import xarray as xr

import dechirp as dc
from dechirp.core.compiled_kernels import use_compiled_kernels

use_compiled_kernels()  # warm from the first call on

FRAMES_PER_S = 20
CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    ramp_duration_s=30e-6,
    sample_rate_hz=10e6,
    n_samples=256,
    sampling="complex",
)
RADAR = dc.Radar(
    frame=dc.Frame(
        chirp=CHIRP,
        n_chirps=128,
        interval_s=40e-6,
        period_s=1 / FRAMES_PER_S,
        multiplexing=dc.multiplexing.Tdm(order=(0, 1)),
    ),
    array=dc.Array(
        tx_m=((0.0, 0.0, 0.0), (0.0, 0.0076, 0.0)),
        rx_m=tuple((0.0, 0.0019 * n, 0.0) for n in range(4)),
    ),
)
FRAME_BYTES = RADAR.frame.n_chirps_total * 4 * 256 * 4
SENDER = """
import sys, dechirp as dc
print(dc.replay(sys.argv[1], sys.argv[2], bytes_per_s=float(sys.argv[3])))
"""


def measure_stream(capture: Path, use: Callable[[int, xr.DataArray], object]) -> dict[str, float]:
    """Replay a capture to a listener and call `use` with the number of each frame and the frame."""
    options = {"radar": RADAR, "device": "xwr1843", "iq": "iq"}
    first = next(iter(dc.open(capture, **options, frames=(0, 1)).frames()))
    use(1, first)  # compiles
    bytes_per_s = str(FRAMES_PER_S * FRAME_BYTES)
    with dc.listen("127.0.0.1:0", **options, idle_s=5) as stream:
        arguments = [sys.executable, "-c", SENDER, str(capture), stream.address, bytes_per_s]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as sender:
            times_s, n_gaps, busy_s = [], 0, 0.0
            for frame in stream:
                if not times_s:
                    busy_s = -time.process_time()
                times_s.append(time.perf_counter())
                n_gaps += bool(frame.gap.any())
                use(len(times_s), frame)
                if len(times_s) * FRAME_BYTES >= capture.stat().st_size:
                    break
            busy_s += time.process_time()
            n_sent = int(sender.communicate()[0])
    elapsed_s = times_s[-1] - times_s[0]
    return {
        "frames": len(times_s),
        "frames_per_s": (len(times_s) - 1) / elapsed_s,
        "packets_sent": n_sent,
        "packets_lost": -(-stream._window.lost_bytes // 1456),
        "frames_with_gaps": n_gaps,
        "share_of_a_core": busy_s / elapsed_s,
    }


def hold_interpreter(n: int, frame: xr.DataArray) -> None:
    """Hold the interpreter lock for 0.5 s at every 15th frame."""
    end_s = time.perf_counter() + (0 if n % 15 else 0.5)
    while time.perf_counter() < end_s:
        sum(range(100))


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    n_frames = round(seconds * FRAMES_PER_S)
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        capture = Path(folder) / "capture.bin"
        frame_bytes = rng.integers(-2000, 2000, FRAME_BYTES // 2, dtype=np.int16).tobytes()
        with capture.open("wb") as out:
            for _ in range(n_frames):
                out.write(frame_bytes)
        measured = {
            "taken": measure_stream(capture, lambda n, frame: None),
            "detected": measure_stream(capture, lambda n, frame: dc.detect(frame, RADAR)),
            "held": measure_stream(capture, hold_interpreter),
        }
    print(json.dumps({"measured": measured, "at_most": {"packets_lost": 0}}, indent=2))
    has_losses = any(
        result["packets_lost"] or result["frames"] < n_frames for result in measured.values()
    )
    raise SystemExit(1 if has_losses else 0)


if __name__ == "__main__":
    main()
