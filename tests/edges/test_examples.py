"""The examples do what they say."""

from pathlib import Path

import numpy as np
import pytest

import dechirp as dc

EXAMPLES = Path(dc.__file__).parents[2] / "examples"


def test_both_vehicles_are_found_in_every_frame_without_a_false_alarm():
    result = dc.run(dc.load(EXAMPLES / "overtaking-car.yaml"))

    assert result.findings == ()
    for name in ("car", "truck"):
        truth = result.truth.sel(target=name)
        for frame in range(20):
            of_frame = result.detections.isel(
                detection=np.flatnonzero(result.detections.frame.values == frame)
            )
            error_m = abs(of_frame.range.values - float(truth.range[frame]))
            nearest = of_frame.isel(detection=int(error_m.argmin()))
            # Five standard errors, and the 0.1 mm by which paths to the receivers differ.
            assert float(error_m.min()) < 5 * float(nearest.range_std) + 3e-4
            error = abs(nearest.velocity - float(truth.velocity[frame]))
            assert float(error) < 5 * float(nearest.velocity_std) + 1e-3
    # 1.3 million cells at 1e-6, fewer of them independent: 8 more than 40 once in 1e5.
    assert result.detections.sizes["detection"] <= 48


@pytest.mark.parametrize("name", ["radar.yaml"])
def test_a_radar_of_the_examples_opens_a_cube(tmp_path, name):
    np.save(tmp_path / "cube.npy", np.ones((128, 128), complex))
    recording = dc.open(
        tmp_path / "cube.npy",
        radar=EXAMPLES / name,
        axes=("chirp", "sample"),
        encoding="full-scale",
    )
    assert recording.cube.sizes == {"frame": 1, "chirp": 128, "rx": 1, "sample": 128}
