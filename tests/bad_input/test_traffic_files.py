"""Traffic files with one fault each, through the command line: messages with object and time."""

import math
import struct

import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.main import main
from nightly import nightly
from sample_osi_views import make_view

pytest.importorskip("osi3")
pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
HEADER = "time,id,class,x,y,heading,length,width,height"
QUICK = ["--frames", "1"]
for setting in (
    "radar.frame.n_chirps=8",
    "tracker=null",
    "chain.cfar.estimator={kind: cell-averaging}",  # needs no calibration
):
    QUICK += ["--set", setting]


def make_views(edit=None, n=5, others=()):
    """Return views of the car 1 behind the car 2; `edit` changes the view of the time 0.2 s."""
    views = [
        make_view(
            0.1 * k,
            {"id": 1, "x": 1.0 * k, "vx": 10.0, "vy": 0.0},
            {"id": 2, "x": 30 + 0.5 * k, "vx": 5.0, "vy": 0.0},
            *others,
        )
        for k in range(n)
    ]
    if edit is not None:
        edit(views[2], views[2].global_ground_truth.moving_object[1].base)
    return views


def write_views(folder, views):
    path = folder / "trace.osi"
    contents = [view.SerializeToString() for view in views]
    path.write_bytes(b"".join(struct.pack("<I", len(part)) + part for part in contents))
    return path


def write_rows(folder, *rows):
    path = folder / "trace.csv"
    cars = [
        f"{k / 10},{number},car,{x_m + k},0,0,4.5,1.8,1.5"
        for k in range(5)
        for number, x_m in ((1, 0), (2, 30))
    ]
    path.write_text("\n".join([HEADER, *cars, *rows]) + "\n", encoding="utf-8")
    return path


def write_mcap(folder, views):
    path = folder / "trace.mcap"
    with path.open("wb") as file:
        writer = pytest.importorskip("mcap.writer").Writer(file, chunk_size=4096)
        writer.start()
        schema = writer.register_schema("osi3.SensorView", "protobuf", b"")
        channel = writer.register_channel("ground_truth", "protobuf", schema)
        for index, view in enumerate(views):
            writer.add_message(channel, index, view.SerializeToString(), index)
        writer.finish()
    return path


def run_command(path, out, capsys):
    """Run a file; return the exit status and all messages in one line."""
    status = 0
    try:
        main(["run", str(path), *QUICK, "--ego", "1", "--out", str(out)])
    except SystemExit as stop:
        status = stop.code
    captured = capsys.readouterr()
    return status, " ".join((captured.out + captured.err).split())


def set_version(major, *, of_truth=False):
    def edit(view, _):
        view.ClearField("version")
        (view.global_ground_truth if of_truth else view).version.version_major = major

    return edit


def set_number(name, value):
    def edit(_, base):
        message, _, field = name.rpartition(".")
        setattr(getattr(base, message), field, value)

    return edit


def set_time(seconds):
    def edit(view, _):
        view.global_ground_truth.timestamp.nanos = round(seconds * 1e9)

    return edit


def set_id(number):
    def edit(view, _):
        view.global_ground_truth.moving_object[1].id.value = number

    return edit


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (set_version(2), "message 2, with object 1, at 0.2 s: OSI version 2.0; expected version 3"),
        (set_version(4, of_truth=True), "message 2, with object 1, at 0.2 s: OSI version 4.0"),
        (set_number("dimension.length", -1.0), "object 2 at 0.2 s: length -1 m"),
        (set_number("dimension.width", math.inf), "object 2 at 0.2 s: width inf m"),
        (set_number("position.x", math.nan), "object 2 at 0.2 s: x nan"),
        (
            set_number("position.x", 1e300),
            "object 2 at 0.2 s: position 1e+300, 0, 0.75 m; expected at most",
        ),
        (set_number("position.z", math.inf), "object 2 at 0.2 s: position 31, 0, inf m"),
        (set_number("velocity.x", 1e9), "object 2 at 0.2 s: velocity 1e+09, 0 m/s"),
        (set_number("orientation.yaw", math.inf), "object 2 at 0.2 s: heading inf rad"),
        (set_time(0.05), "message 2, with object 1, at 0.05 s after one at 0.1 s"),
        (set_time(0.1), "object 1 twice at 0.1 s"),
        (set_id(1), "object 1 twice at 0.2 s"),
    ],
)
def test_faults_of_osi_traces_end_with_object_and_time(tmp_path, capsys, edit, expected):
    status, text = run_command(write_views(tmp_path, make_views(edit)), tmp_path / "out", capsys)

    assert status == 2
    assert expected in text


def drop_version(view, _):
    view.ClearField("version")


@pytest.mark.parametrize(
    ("views", "expected"),
    [
        (lambda: [drop_version(view, 0) or view for view in make_views()], "no version of OSI"),
        (
            lambda: [
                set_number("dimension.length", math.nan)(
                    view, view.global_ground_truth.moving_object[1].base
                )
                or view
                for view in make_views()
            ],
            "of 1 object are unknown: car-2 from 0 s",
        ),
        (
            lambda: make_views(others=[{"id": number, "x": 50.0, "vx": 0.0} for number in (3, 4)]),
            "objects overlap: 3 and 4 at 0 s",
        ),
        (
            lambda: make_views(others=[{"id": 3, "x": 4.0, "vx": 0.0, "vy": 0.0}]),
            "the radar is inside 1 object, left out: car-3 at 0.00",
        ),
    ],
    ids=["version missing", "NaN dimension", "one place", "around the radar"],
)
def test_surprises_of_osi_traces_are_findings_with_object_and_time(tmp_path, views, expected):
    scenes = dc.traffic.FrameScenes(dc.open_traffic(write_views(tmp_path, views())), RADAR)

    scenes.scene(0)

    assert expected in " ".join(map(str, scenes.findings))


@nightly
def test_command_states_the_findings_of_a_trace(tmp_path, capsys, without_figures):
    views = make_views(others=[{"id": 3, "x": 4.0, "vx": 0.0, "vy": 0.0}])

    status, text = run_command(write_views(tmp_path, views), tmp_path / "out", capsys)

    assert status == 0, text
    assert "the radar is inside 1 object, left out: car-3 at 0.00" in text


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("0.2,3,car,50,0,0,inf,1.8,1.5", "object 3 at 0.2 s: length inf m"),
        ("0.2,3,car,50,0,1e9,4,1.8,1.5", "object 3 at 0.2 s: heading 1e+09 rad"),
        ("1e20,3,car,50,0,0,4,1.8,1.5", "object 3 at 1e+20 s: time 1e+20 s"),
        ("0.2,3,car,1e12,0,0,4,1.8,1.5", "object 3 at 0.2 s: position 1e+12, 0, nan m"),
        ("0.2,3,wall,50,0,0,1e6,0.3,2", "object 3: Wall.length_m 1000000.0, from 0"),
    ],
)
def test_impossible_numbers_of_trajectories_are_refused(tmp_path, capsys, row, expected):
    status, text = run_command(write_rows(tmp_path, row), tmp_path / "out", capsys)

    assert status == 2
    assert expected in text


@nightly
def test_thousand_objects_have_scenes(tmp_path):
    others = [
        {"id": 10 + i, "x": 20 + (i % 40) * 4.7, "y": -40 + (i // 40) * 3.3, "vx": 10.0, "vy": 0.0}
        for i in range(1000)
    ]
    path = write_views(tmp_path, make_views(n=1, others=others))
    scenario = dc.traffic.traffic_scenario(path, ["radar.frame.n_chirps=8"])
    scenes = scenario.traffic.open_scenes(scenario.radar)

    scene = scenes.scene(0)

    assert len(scene.targets) > 400
    assert scene.n_scatterers > 30_000


def mutate(content, rng):
    """Return bytes with some changed, cut or doubled."""
    content = bytearray(content)
    if content.startswith(b"time,") and rng.integers(2):
        place = int(rng.integers(content.index(b"\n")))  # few of all places are in the header
        content[place:place] = [b" ", b"\t", b"\xef\xbb\xbf", b",", b'"', b"\r"][rng.integers(6)]
    for _ in range(rng.integers(1, 5)):
        place = int(rng.integers(len(content)))
        content[place] = int(rng.integers(256))
    place, kind = int(rng.integers(len(content))), rng.integers(4)
    if kind == 0:
        del content[place:]
    elif kind == 1:
        content[place:place] = content[place : place + 40]
    return bytes(content)


@nightly
@pytest.mark.parametrize("suffix", ["csv", "osi", "xml", "mcap"])
def test_mutated_copies_are_read_or_refused_in_bounded_time_and_memory(tmp_path, suffix):
    resource = pytest.importorskip("resource")
    if suffix == "mcap":
        original = write_mcap(tmp_path, make_views())
    elif suffix == "osi":
        original = write_views(tmp_path, make_views())
    elif suffix == "csv":
        original = write_rows(tmp_path)
    else:
        original = tmp_path / "scenario.xml"
        original.write_text(COMMON_ROAD, encoding="utf-8")
    content, rng = original.read_bytes(), np.random.default_rng(32)
    path = tmp_path / f"mutated.{suffix}"
    n_read = 0
    # The peak is that of the process, in kilobytes, and may be of another test.
    peak_before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(300):
        path.write_bytes(mutate(content, rng))
        start_s = resource.getrusage(resource.RUSAGE_SELF)
        try:
            traffic = dc.open_traffic(path)
            scenes = dc.traffic.FrameScenes(traffic, RADAR, ego=int(traffic.objects["id"][0]))
            scenes.scene(scenes.n_frames - 1)
            n_read += 1
        except dc.DechirpError as error:
            assert len(str(error)) < 1000
        used = resource.getrusage(resource.RUSAGE_SELF)
        assert used.ru_utime - start_s.ru_utime < 20
    assert used.ru_maxrss - peak_before < 2**20
    assert 0 < n_read < 300


RADAR = dc.reference().radar
COMMON_ROAD = """<?xml version="1.0"?>
<commonRoad commonRoadVersion="2020a" timeStepSize="0.5">
  <dynamicObstacle id="40"><type>car</type>
    <shape><rectangle><length>4.5</length><width>1.8</width></rectangle></shape>
    <initialState><position><point><x>1</x><y>2</y></point></position>
      <orientation><exact>0.5</exact></orientation><time><exact>2</exact></time>
      <velocity><exact>4</exact></velocity></initialState>
    <trajectory><state><position><point><x>2.5</x><y>4</y></point></position>
      <orientation><exact>0.5</exact></orientation>
      <time><exact>3</exact></time><velocity><exact>4</exact></velocity></state></trajectory>
  </dynamicObstacle>
  <staticObstacle id="41"><type>building</type><shape><circle><radius>2</radius></circle>
    </shape><initialState><position><point><x>9</x><y>9</y></point></position>
    <time><exact>2</exact></time></initialState></staticObstacle>
</commonRoad>
"""
