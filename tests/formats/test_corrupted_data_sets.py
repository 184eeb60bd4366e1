"""Corrupted folders and public data sets: readers that the tests of other formats do not cover."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from formats.corruption import assert_cube_or_error, corrupted_bytes
from nightly import n_examples

CHIRP = Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    ramp_duration_s=30e-6,
    sample_rate_hz=10e6,
    n_samples=8,
    sampling="complex",
)
SINGLE_TX_RADAR = Radar(
    frame=Frame(chirp=CHIRP, n_chirps=4, interval_s=40e-6),
    array=Array(rx_m=tuple((0.0, 0.002 * n, 0.0) for n in range(16))),
)
TDM_RADAR = Radar(
    frame=replace(SINGLE_TX_RADAR.frame, multiplexing=Tdm(order=(1, 0))),
    array=Array(tx_m=((0.0, 0.0, 0.0), (0.0, 0.008, 0.0)), rx_m=SINGLE_TX_RADAR.array.rx_m[:4]),
)


def draw_codes(*shape: int, dtype: str = "<i2") -> np.ndarray:
    return np.random.default_rng(1).integers(0, 4096, shape).astype(dtype)


def write_infineon(folder: Path) -> dict[str, object]:
    shape = {"num_samples_per_chirp": 8, "num_chirps_per_frame": 4, "rx_antennas": [1, 2]}
    shape |= {"start_frequency_Hz": 58e9, "end_frequency_Hz": 63e9, "sample_rate_Hz": 2e6}
    shape |= {"chirp_repetition_time_s": 5e-4, "frame_repetition_time_s": 0.08}
    text = json.dumps({"device_config": {"fmcw_single_shape": {**shape, "mimo_mode": "off"}}})
    (folder / "config.json").write_text(text)
    np.save(folder / "radar.npy", draw_codes(3, 2, 4, 8, dtype="<u2"))
    return {}


def write_coloradar(folder: Path) -> dict[str, object]:
    draw_codes(2, 4, 4, 8, 2).tofile(folder / "frame.bin")
    return {"radar": TDM_RADAR, "format": "coloradar"}


def write_radial(folder: Path) -> dict[str, object]:
    for chip in range(4):
        draw_codes(4, 4, 8, 2).tofile(folder / f"adc{chip}")
    return {"radar": SINGLE_TX_RADAR, "format": "radial"}


def write_raddet(folder: Path) -> dict[str, object]:
    np.save(folder / "frame.npy", draw_codes(8, 4, 4, 2) + 1j)
    return {"radar": TDM_RADAR, "format": "raddet", "encoding": "int16"}


def write_radical(folder: Path) -> dict[str, object]:
    import h5py

    with h5py.File(folder / "set.h5", "w") as file:
        file["radar"] = draw_codes(2, 4, 8, 8) + 1j
    return {"radar": TDM_RADAR, "format": "radical", "encoding": "int16"}


@pytest.mark.parametrize(
    "writer", [write_infineon, write_coloradar, write_radial, write_raddet, write_radical]
)
@settings(max_examples=n_examples(80))
@given(data=st.data())
def test_corrupted_file_gives_cube_or_error(tmp_path_factory, writer, data):
    folder = tmp_path_factory.mktemp(writer.__name__)
    options = writer(folder)
    files = sorted(folder.iterdir())
    path = files[0] if len(files) == 1 else folder
    assert_cube_or_error(path, **options)

    file = data.draw(st.sampled_from(files))
    file.write_bytes(data.draw(corrupted_bytes(file.read_bytes())))

    assert_cube_or_error(path, **options)
