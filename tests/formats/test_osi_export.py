"""Traffic files as messages of ASAM OSI, step by step."""

import struct

import numpy as np
import pytest

import dechirp as dc
from dechirp.traffic.base import STRUCTURE_KINDS, ObjectKind

pytest.importorskip("osi3")
pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
KINDS = ObjectKind.__args__


def write_trace(folder):
    """Write an object of each kind; those that move drive at 3 m/s, the first without a size."""
    rows = ["time,id,class,x,y,heading,length,width,height,z,vx,vy"]
    for k in range(4):
        for number, kind in enumerate(KINDS, 1):
            is_structure = kind in STRUCTURE_KINDS
            step_m, speed = (0.0, 0.0) if is_structure else (0.3, 3.0)
            size = ",," if number == 1 else "3,1.5,2"
            place = f"{10 * number + step_m * k},{number},0,{size},1,{speed},0"
            rows.append(f"{1.7e9 + k / 10:.1f},{number},{kind},{place}")
    path = folder / "trace.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_views_contain_what_the_file_does(tmp_path):
    written = dc.open_traffic(write_trace(tmp_path))

    views = list(dc.traffic.sensor_views(written, ego=2))

    contents = [view.SerializeToString() for view in views]
    path = tmp_path / "trace.osi"
    path.write_bytes(b"".join(struct.pack("<I", len(part)) + part for part in contents))
    read = dc.open_traffic(path)
    assert read.host == 2 and read.objects["time"].values == pytest.approx([0, 0.1, 0.2, 0.3])
    objects = read.objects.sortby("id")
    assert objects["kind"].values.tolist() == list(KINDS)
    for name in ("x", "y", "z", "heading", "vx", "vy", "length", "width", "height"):
        assert np.array_equal(objects[name], written.objects[name], equal_nan=True), name


def test_sensor_model_steps_through_a_file(tmp_path):
    path = tmp_path / "trace.csv"
    rows = [
        f"{k / 10},{n},car,{x + 0.2 * n * k},0,0,4.5,1.8,1.5"
        for k in range(6)
        for n, x in ((1, 0), (2, 20))
    ]
    path.write_text("\n".join(["time,id,class,x,y,heading,length,width,height", *rows]), "utf-8")
    scenario = dc.traffic.traffic_scenario(path, ["traffic.ego=1", "radar.frame.n_chirps=32"])
    model = dc.SensorModel(scenario, kind="statistical")

    data = [model.step(view) for view in dc.traffic.sensor_views(path, ego=1)]

    assert len(data) == 6 and len(data[-1].moving_object) == 1
    # 20 m between the centres, 2 m/s more for 0.5 s; the track follows the centre within 2 m.
    assert data[-1].moving_object[0].base.position.x == pytest.approx(21 - 2.25, abs=2.0)


def test_steps_without_the_host_are_left_out_and_unknown_hosts_refused(tmp_path):
    path = tmp_path / "trace.csv"
    rows = [f"{k},{n},car,{9 * n + k},0,0,4.5,1.8,1.5" for k in range(4) for n in (1, 2) if k != n]
    path.write_text("\n".join(["time,id,class,x,y,heading,length,width,height", *rows]), "utf-8")

    times_s = [view.timestamp.seconds for view in dc.traffic.sensor_views(path, ego=2)]

    assert times_s == [0, 1, 3]
    for ego in (None, 7):
        with pytest.raises(
            dc.InvalidSetting, match="sensor_views.ego: .*expected an object.*: 1, 2"
        ):
            dc.traffic.sensor_views(path, ego=ego)
