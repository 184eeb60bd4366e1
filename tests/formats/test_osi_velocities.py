"""Velocities of ASAM OSI traces that are zero or missing although positions move."""

import struct

import numpy as np
import pytest

import dechirp as dc
from sample_osi_views import make_view

pytest.importorskip("osi3")
SPEED = 8.0


def write_trace(path, stated, message, fields=("vx", "vy")):
    """Write ten messages of 0.1 s: car 1 and truck 2 drive at 8 m/s, car 3 stands.

    Only velocities of `fields` are set: the stated one along x, and 0 along y.
    """
    contents = []
    for k in range(10):
        x_m = SPEED * 0.1 * k
        rest = {} if stated is None else dict.fromkeys(fields, 0.0)
        moving = {field: stated if field == "vx" else 0.0 for field in rest}
        view = make_view(
            0.1 * k,
            {"id": 1, "x": x_m, **moving},
            {"id": 2, "x": 40 + x_m, "y": 3.5, **moving},
            {"id": 3, "x": 60.0, "y": -3.5, **rest},
        )
        part = view if message == "view" else view.global_ground_truth
        contents.append(part.SerializeToString())
    path.write_bytes(b"".join(struct.pack("<I", len(part)) + part for part in contents))
    return path


@pytest.mark.parametrize("message", ["view", "truth"])
@pytest.mark.parametrize("stated", [0.0, None], ids=["zero", "missing"])
def test_velocities_of_moving_objects_come_from_positions(tmp_path, stated, message):
    traffic = dc.open_traffic(write_trace(tmp_path / "trace.osi", stated, message))

    # Differences of a constant velocity are exact but for the rounding of positions.
    expected = np.repeat([SPEED, SPEED, 0.0], 10).reshape(3, 10)
    assert traffic.objects["vx"].values == pytest.approx(expected, abs=1e-9)
    assert traffic.objects["vy"].values == pytest.approx(np.zeros((3, 10)), abs=1e-9)
    (finding,) = [item for item in traffic.findings if item.setting == "traffic.velocity"]
    assert finding.value.startswith("velocities of 2 objects are missing, or zero although they")
    assert (
        "1 from 0 s (8 m/s), 2 from 0 s (8 m/s)" in finding.value and "3 from" not in finding.value
    )


@pytest.mark.parametrize("message", ["view", "truth"])
def test_stated_velocities_are_no_finding(tmp_path, message):
    traffic = dc.open_traffic(write_trace(tmp_path / "trace.osi", SPEED, message))

    assert not [item for item in traffic.findings if item.setting == "traffic.velocity"]


@pytest.mark.parametrize("message", ["view", "truth"])
def test_component_that_is_not_set_is_zero_if_the_other_one_is(tmp_path, message):
    path = write_trace(tmp_path / "trace.osi", SPEED + 0.5, message, fields=("vx",))
    traffic = dc.open_traffic(path)

    # Positions give 8 m/s: the stated 8.5 m/s stays only if the velocity does not count as missing.
    expected = np.repeat([SPEED + 0.5, SPEED + 0.5, 0.0], 10).reshape(3, 10)
    np.testing.assert_allclose(traffic.objects["vx"].values, expected)
    np.testing.assert_array_equal(traffic.objects["vy"].values, np.zeros((3, 10)))
    assert not [item for item in traffic.findings if item.setting == "traffic.velocity"]
