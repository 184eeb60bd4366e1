"""Own motion, clusters and tracks of a run: who is followed, what is kept, what is refused."""

import csv
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.experiments.object_stage import run_object_stage
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.cluster import Dbscan
from dechirp.tracking.ego import EgoMotion
from dechirp.tracking.tracker import Tracker

SPEED, N_FRAMES = 10.0, 6
SCENE = """
name: street
seed: 2
n_frames: 6
radar:
  frame:
    chirp: {start_frequency: 76.5 GHz, slope: 20 MHz/us, adc_start: 1 us, ramp_duration: 14 us,
            sample_rate: 20 MHz, n_samples: 256, sampling: complex}
    n_chirps: 64
    interval: 20 us
    period: 50 ms
  array:
    tx: [[0, 0, 0]]
    rx: [[0, 0, 0], [0, 1.9 mm, 0], [0, 3.8 mm, 0], [0, 5.7 mm, 0],
         [0, 7.6 mm, 0], [0, 9.5 mm, 0], [0, 11.4 mm, 0], [0, 13.3 mm, 0]]
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
scene:
  ego: {velocity: [10 m/s, 0, 0]}
  targets:
    - {name: car, position: [30 m, 1 m, 0], velocity: [16 m/s, 0, 0], rcs: 10 dBsm}
    - {name: post-1, position: [12 m, 6 m, 0]}
    - {name: post-2, position: [18 m, -7 m, 0]}
    - {name: post-3, position: [24 m, 9 m, 0]}
    - {name: post-4, position: [28 m, -12 m, 0]}
    - {name: post-5, position: [36 m, 20 m, 0], rcs: 10 dBsm}
    - {name: post-6, position: [42 m, -16 m, 0], rcs: 10 dBsm}
    - {name: post-7, position: [20 m, 14 m, 0]}
    - {name: post-8, position: [15 m, -12 m, 0]}
chain: {cluster: {}}
ego_motion: {}
tracker: {}
"""


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    path = tmp_path_factory.mktemp("street") / "street.yaml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def result(street):
    return dc.run(dc.load(street))


def test_of_a_street_the_own_speed_is_told_and_the_car_alone_has_a_track(result):
    assert abs(result.ego.vx.values - SPEED).max() < 0.1
    assert abs(result.ego.vy.values).max() < 0.1
    assert result.tracks.sizes["track"] == 1
    last = result.tracks.isel(track=0, frame=-1)
    truth = result.truth.sel(target="car").isel(frame=-1)
    x, y = truth.range * np.cos(truth.azimuth), truth.range * np.sin(truth.azimuth)
    assert last.status == "confirmed"
    assert abs(last.x - x) < 0.2
    assert abs(last.y - y) < 0.5
    assert last.vx == pytest.approx(6, abs=0.5)  # as the radar sees it


def test_posts_stand_still_the_car_moves_and_each_is_a_cluster(result):
    moving = result.clusters.motion.values == "moving"
    assert moving.sum() == N_FRAMES
    assert set(result.clusters.motion.values) == {"static", "moving"}
    assert (result.clusters.velocity.values[moving] > 5).all()
    # What a cluster is, its detections are.
    of = result.clusters.motion.values[result.detections.cluster.values]
    assert (of == result.detections.motion.values).all()


def test_files_of_a_run_hold_what_was_followed(street, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["run", str(street), "--out", str(tmp_path / "out"), "--quiet"])
    assert ended.value.code == 0, capsys.readouterr().err
    document = json.loads((tmp_path / "out" / "run.json").read_text())
    rows = {
        name: list(csv.DictReader((tmp_path / "out" / f"{name}.csv").read_text().splitlines()))
        for name in ("ego", "clusters", "tracks")
    }
    assert [float(row["vx_m_per_s"]) for row in rows["ego"]] == pytest.approx([SPEED] * 6, abs=0.1)
    for name in ("clusters", "tracks"):
        assert len(rows[name]) == len(document[name]) > 0
        assert f"{name}.csv" in document["files"]
    assert {row["motion"] for row in rows["clusters"]} == {"static", "moving"}
    assert rows["tracks"][-1]["status"] == "confirmed"
    assert float(rows["tracks"][-1]["covariance_x_x"]) > 0


def test_without_own_motion_all_that_is_detected_is_tracked(street):
    result = dc.run(dc.load(street, ["ego_motion=null", "chain.cluster=null"]))
    assert result.ego is None
    assert result.clusters is None
    assert result.tracks.sizes["track"] == 9


def test_without_detections_there_is_nothing_to_follow(result):
    none = result.detections.drop_vars(["cluster", "motion"]).isel(detection=[])
    made = run_object_stage(none, result.times_s, result.scenario, result.radar)
    assert made.ego.sizes["frame"] == made.clusters.sizes["cluster"] == 0
    assert made.tracks.sizes["track"] == 0
    assert made.tracks.sizes["frame"] == N_FRAMES
    assert made.findings == ()


def test_where_no_motion_is_told_the_user_hears_it_and_all_is_tracked(result):
    shy = replace(result.scenario, ego_motion=EgoMotion(min_static=100))
    bare = result.detections.drop_vars(["cluster", "motion"])
    made = run_object_stage(bare, result.times_s, shy, result.radar)
    (finding,) = made.findings
    assert (finding.setting, finding.value[:29]) == ("ego_motion", "no motion of the radar in 6 o")
    assert made.tracks.sizes["track"] == 9


ONE_ELEMENT = "radar.array={tx: [[0, 0, 0]], rx: [[0, 0, 0]]}"
LEAKAGE = "chain.mitigation=[{kind: leakage-subtraction, max_range: 5 km}]"
CANCELLER = "chain.mitigation=[{kind: moving-target-indication, order: 3}]"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["tracker.confirm_after=[7, 9]"], "tracker.confirm_after: 7 detections, in a run of 6"),
        (["tracker.confirm_after=[4, 3]"], "tracker.confirm_after: 4 detections in 3 frames"),
        (["ego_motion=null", ONE_ELEMENT], "tracker: enabled for detections without direct"),
        (["tracker=null", ONE_ELEMENT], "ego_motion: enabled for detections without direct"),
        (["chain.angle=null"], "tracker: enabled for|ego_motion: enabled for"),
        (
            [LEAKAGE],
            "chain.mitigation.leakage-subtraction.max_range: 5000 m; expected",
        ),
        ([CANCELLER, "radar.frame.n_chirps=3"], "radar.frame.n_chirps: 3, under mitigation"),
    ],
)
def test_what_can_never_be_told_is_refused_by_its_path_before_anything_is_simulated(
    street, changes, message
):
    with pytest.raises(dc.InvalidFile, match=message):
        dc.load(street, changes)


def test_a_recording_of_too_few_frames_is_refused_before_it_is_processed(result, tmp_path):
    from dechirp.recordings.cube_store import write_cube

    path = tmp_path / "two.zarr"
    frames = (result.cube.isel(frame=[i]) for i in range(2))
    write_cube(path, frames, n_frames=2, radar=result.radar, groups={})
    heard = []
    scenario = dc.Scenario(recording=RecordingSource(path=str(path)), tracker=Tracker())
    with pytest.raises(dc.InvalidSetting, match="tracker.confirm_after: 3 detections, in a run"):
        dc.run(scenario, progress=lambda done, of: heard.append(done))
    assert not heard


def test_that_stone_soup_is_missing_is_said_before_anything_is_simulated(result, monkeypatch):
    monkeypatch.delitem(sys.modules, "dechirp.tracking.stone_soup", raising=False)
    for name in [name for name in sys.modules if name.partition(".")[0] == "stonesoup"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, "stonesoup", None)
    heard = []
    with pytest.raises(
        dc.InvalidSetting,
        match=r"^tracker: a tracker without Stone Soup"
        r" .*'dechirp\[track\]",
    ):
        dc.run(result.scenario, progress=lambda done, of: heard.append(done))
    assert not heard


def test_settings_of_another_kind_are_refused(result):
    for name, wrong in (("tracker", Dbscan()), ("ego_motion", {})):
        with pytest.raises(dc.InvalidSetting, match=f"Scenario.{name}"):
            replace(result.scenario, **{name: wrong})
