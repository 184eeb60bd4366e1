"""Speed of writing and reading int16 codes in a Zarr store relative to a plain file.

A frame has 1 MiB: 128 chirps, 8 receivers and 256 complex samples of 12-bit noise. The recordings
have 20 and 256 frames. New files are written in each repetition, below FOLDER or the temporary
folder, and stay in the file cache. dechirp and reference run alternately (A B A B); a ratio
divides their shortest times:

write    `write_cube_store` with int16 codes, over `ndarray.tofile` with the same codes; at most 2.
encode   `write_cube_store` with the complex64 cube, including encoding and an exact check, over
         encoding with NumPy (cube / scale, rint, astype) and `tofile`.
read     `zarr.open_array(...)[:]` for all codes, over `numpy.fromfile`; at most 2.
decode   `dechirp.open(...).cube`, a complex64 cube, over `fromfile` and codes * scale.
frames   `dechirp.open(...).frames()`, with one frame in memory, over the same.

The time to write radar, coordinates and metadata does not depend on the number of frames. It is
part of `write` and `encode`; the time for a store of one frame, ms, is printed for comparison.

    python benchmarks/exchange.py [FOLDER]
"""

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[pool] = "1"

import numpy as np
import xarray as xr
import zarr

import dechirp as dc
from dechirp.radar.cube import label_cube
from dechirp.recordings.cube_store import write_cube_store
from dechirp.simulation.adc_codes import extract_adc_codes

N_CHIRPS, N_RX, N_SAMPLES = 128, 8, 256
SCALE = 2.0**-15
TURNS = 9
CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    ramp_duration_s=30e-6,
    sample_rate_hz=10e6,
    n_samples=N_SAMPLES,
    sampling="complex",
)
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=N_CHIRPS, interval_s=40e-6, period_s=50e-3),
    array=dc.Array(rx_m=tuple((0.0, 0.002 * n, 0.0) for n in range(N_RX))),
)


class Case:
    """ADC codes of n frames, with functions that write and read them."""

    def __init__(self, folder: Path, n_frames: int) -> None:
        rng = np.random.default_rng(1)
        shape = (n_frames, N_CHIRPS, N_RX, N_SAMPLES, 2)
        self.numbers = rng.normal(0, 40, shape).round().astype(np.int16)
        samples = (self.numbers * np.float32(SCALE)).view(np.complex64)[..., 0]
        self.cube = label_cube(samples, RADAR, units="1").assign_attrs(scale=SCALE)
        self.codes = extract_adc_codes(self.cube)
        self.frames_of_codes, self.frames_of_cube = (
            [cube[index : index + 1] for index in range(n_frames)]
            for cube in (self.codes, self.cube)
        )
        self.store, self.plain_file = folder / "x.zarr", folder / "x.bin"

    def delete_files(self) -> None:
        """Delete the store and the plain file."""
        shutil.rmtree(self.store, ignore_errors=True)
        self.plain_file.unlink(missing_ok=True)

    def tofile(self) -> None:
        """Write the codes to a plain file."""
        self.numbers.tofile(self.plain_file)

    def write(self, frames: list[xr.DataArray]) -> None:
        """Write frames to a store."""
        write_cube_store(self.store, frames, n_frames=len(frames), radar=RADAR, groups={})

    def encode_with_numpy(self) -> None:
        """Encode the samples with NumPy and write them to a plain file."""
        parts = self.cube.values.view(np.float32)
        np.rint(parts / np.float32(SCALE)).astype(np.int16).tofile(self.plain_file)

    def fromfile(self) -> np.ndarray:
        """Read the codes of the plain file."""
        return np.fromfile(self.plain_file, np.int16)

    def read(self) -> np.ndarray:
        """Read the codes of the store with Zarr only."""
        return np.asarray(zarr.open_array(self.store / "cube", mode="r")[:])

    def decode_with_numpy(self) -> np.ndarray:
        """Read the plain file and decode its samples with NumPy."""
        return (self.fromfile() * np.float32(SCALE)).view(np.complex64)

    def decode(self) -> np.ndarray:
        """Read all samples of the store into one cube."""
        return dc.open(self.store).cube.values

    def frames(self) -> None:
        """Read the samples of the store frame by frame."""
        for _ in dc.open(self.store).frames():
            pass


def time_call(call: Callable[[], object], prepare: Callable[[], object]) -> float:
    prepare()
    start = perf_counter()
    result = call()
    elapsed_s = perf_counter() - start
    del result
    return elapsed_s


def measure_ratio(
    ours: Callable[[], object], reference: Callable[[], object], prepare: Callable[[], object]
) -> dict[str, float]:
    """Time both calls alternately; return their shortest times, ms, and the ratio."""
    pairs = [(time_call(ours, prepare), time_call(reference, prepare)) for _ in range(TURNS)]
    dechirp_s, reference_s = (min(times) for times in zip(*pairs, strict=True))
    return {
        "ratio": round(dechirp_s / reference_s, 2),
        "ms": round(1e3 * dechirp_s, 1),
        "of_ms": round(1e3 * reference_s, 1),
    }


def measure_store(folder: Path, n_frames: int) -> dict[str, object]:
    case = Case(folder, n_frames)
    code_frames, sample_frames = case.frames_of_codes, case.frames_of_cube
    case.write(sample_frames[:1])  # imports and compiles
    one_frame_s = [
        time_call(lambda: case.write(code_frames[:1]), case.delete_files) for _ in range(TURNS)
    ]
    results: dict[str, object] = {
        "MiB": case.numbers.nbytes >> 20,
        "one frame, ms": round(1e3 * min(one_frame_s), 1),
        "write": measure_ratio(lambda: case.write(code_frames), case.tofile, case.delete_files),
        "encode": measure_ratio(
            lambda: case.write(sample_frames), case.encode_with_numpy, case.delete_files
        ),
    }
    case.delete_files()
    case.write(code_frames)
    case.tofile()
    case.decode()
    for name, ours, reference in (
        ("read", case.read, case.fromfile),
        ("decode", case.decode, case.decode_with_numpy),
        ("frames", case.frames, case.decode_with_numpy),
    ):
        results[name] = measure_ratio(ours, reference, lambda: None)
    case.delete_files()
    return results


def main() -> None:
    parent = sys.argv[1] if len(sys.argv) > 1 else None
    with tempfile.TemporaryDirectory(dir=parent) as folder:
        print(json.dumps([measure_store(Path(folder), n) for n in (20, 256)], indent=2))


if __name__ == "__main__":
    main()
