"""Speed of generated C relative to the floating-point chain, from samples to detected cells.

C       Frame of 256 samples x 128 chirps x 1 channel: all chirps pushed, the frame finished, all
        detections read. Words of 16 bits, compiled with the flags of the generated Makefile.
float   `power_map`, `threshold_map` and the comparison of the two.

Both run on one thread, alternately; each figure is the median of 15 pairs, each value of a pair the
fastest of seven calls.

    python benchmarks/generated_c.py
"""

import ctypes
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from speed import compare

import dechirp as dc

BAR = 3.0
PROGRAM = """\
#include "radar.h"
static radar_state state;
static radar_word cube[RADAR_CUBE_WORDS];
static radar_detection detections[64];
unsigned process_frame(const radar_sample *samples)
{
    unsigned n = 0, chirp;
    radar_initialise(&state, cube);
    for (chirp = 0; chirp < RADAR_N_CHIRPS_SENT; ++chirp)
        radar_push_chirp(&state, samples + chirp * RADAR_CHIRP_WORDS);
    radar_finish_frame(&state);
    for (size_t found; (found = radar_read_detections(&state, detections, 64)) > 0;) n += found;
    return n;
}
"""


def compile_library(folder: Path) -> ctypes.CDLL:
    """Compile the generated source with a function that processes a whole frame."""
    (folder / "process_frame.c").write_text(PROGRAM)
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        sys.exit("no C compiler")
    options = ("-O3", "-std=c99", "-shared", "-fPIC", "-o", "frame.so")
    subprocess.run([compiler, *options, "radar.c", "process_frame.c"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "frame.so"))


def make_radar(n_chirps: int) -> dc.Radar:
    """Return a radar with chirps of 256 complex samples and one channel."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        ramp_duration_s=30e-6,
        sample_rate_hz=10e6,
        n_samples=256,
        sampling="complex",
    )
    frame = dc.Frame(chirp=chirp, n_chirps=n_chirps, interval_s=35e-6)
    hardware = dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0)
    return dc.Radar(frame=frame, hardware=hardware)


def main() -> None:
    radar, chain = make_radar(n_chirps=128), dc.Chain()
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 0, 0), rcs_m2=10)])
    cube = dc.simulate(scene, radar, seed=1).isel(frame=0)
    parts = np.stack([cube.values.real, cube.values.imag], axis=-1)
    codes = np.rint(parts / abs(parts).max() * (2**15 - 1)).astype(np.int16)

    def detect_in_floating_point() -> int:
        power = dc.power_map(cube, radar, chain)
        return int((power.values > dc.threshold_map(power, radar, chain).values).sum())

    with tempfile.TemporaryDirectory() as folder:
        dc.generators.C().write(Path(folder) / "c", radar, chain)
        library = compile_library(Path(folder) / "c")
        address = ctypes.c_void_p(codes.ctypes.data)
        assert library.process_frame(address) == detect_in_floating_point()
        compare(
            "C, 256 x 128 x 1",
            lambda: library.process_frame(address),
            detect_in_floating_point,
            BAR,
        )


if __name__ == "__main__":
    main()
