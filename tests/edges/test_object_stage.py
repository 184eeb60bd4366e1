"""Ego motion, clusters and tracks of a run, their files, and invalid settings."""

import csv
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.experiments.object_stage import estimate_ego_motion_clusters_tracks
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.cluster import Dbscan
from dechirp.tracking.ego import EgoMotion
from dechirp.tracking.tracker import Tracker
from nightly import nightly

pytestmark = pytest.mark.usefixtures("without_figures")


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


def test_ego_speed_is_estimated_and_only_car_has_track(result):
    assert abs(result.ego.vx.values - SPEED).max() < 0.1
    assert abs(result.ego.vy.values).max() < 0.1
    assert result.tracks.sizes["track"] == 1
    last = result.tracks.isel(track=0, frame=-1)
    truth = result.truth.sel(target="car").isel(frame=-1)
    x, y = truth.range * np.cos(truth.azimuth), truth.range * np.sin(truth.azimuth)
    assert last.status == "confirmed"
    assert abs(last.x - x) < 0.2
    assert abs(last.y - y) < 0.5
    assert last.vx == pytest.approx(6, abs=0.5)  # relative to the radar


def test_posts_are_static_clusters_and_car_is_moving_cluster(result):
    moving = result.clusters.motion.values == "moving"
    assert moving.sum() == N_FRAMES
    assert set(result.clusters.motion.values) == {"static", "moving"}
    assert (result.clusters.velocity.values[moving] > 5).all()
    # Detections have the motion class of their cluster.
    cluster_motion = result.clusters.motion.values[result.detections.cluster.values]
    assert (cluster_motion == result.detections.motion.values).all()


def test_run_files_contain_ego_motion_clusters_and_tracks(street, tmp_path, capsys):
    with pytest.raises(SystemExit) as exit_info:
        main(["run", str(street), "--out", str(tmp_path / "out"), "--quiet"])
    assert exit_info.value.code == 0, capsys.readouterr().err
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


def test_tracker_uses_all_detections_without_ego_motion(street):
    result = dc.run(dc.load(street, ["ego_motion=null", "chain.cluster=null"]))
    assert result.ego is None
    assert result.clusters is None
    assert result.tracks.sizes["track"] == 9


def test_no_detections_give_no_tracks(result):
    no_detections = result.detections.drop_vars(["cluster", "motion"]).isel(detection=[])
    stage = estimate_ego_motion_clusters_tracks(
        no_detections, result.times_s, result.scenario, result.radar
    )
    assert stage.ego.sizes["frame"] == stage.clusters.sizes["cluster"] == 0
    assert stage.tracks.sizes["track"] == 0
    assert stage.tracks.sizes["frame"] == N_FRAMES
    assert stage.findings == ()


def test_failed_ego_motion_gives_finding_and_tracks_all_detections(result):
    scenario = replace(result.scenario, ego_motion=EgoMotion(min_static=100))
    detections = result.detections.drop_vars(["cluster", "motion"])
    stage = estimate_ego_motion_clusters_tracks(detections, result.times_s, scenario, result.radar)
    (finding,) = stage.findings
    assert (finding.setting, finding.value[:29]) == ("ego_motion", "no motion of the radar in 6 o")
    assert stage.tracks.sizes["track"] == 9


ONE_ELEMENT = "radar.array={tx: [[0, 0, 0]], rx: [[0, 0, 0]]}"
LEAKAGE = "chain.mitigation=[{kind: leakage-subtraction, max_range: 5 km}]"
CANCELLER = "chain.mitigation=[{kind: moving-target-indication, order: 3}]"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["tracker.confirm_after=[4, 3]"], "tracker.confirm_after: 4 detections in 3 frames"),
        (["ego_motion=null", ONE_ELEMENT], "tracker: enabled for detections without direct"),
        (["tracker=null", ONE_ELEMENT], "ego_motion: enabled for detections without direct"),
        (["chain.angle=null"], "tracker: enabled for|ego_motion: enabled for"),
        (
            ["ego_motion.with_vertical=true"],
            "ego_motion.with_vertical: true for an array that measures no elevation",
        ),
        (
            [LEAKAGE],
            "chain.mitigation.leakage-subtraction.max_range: 5000 m; expected",
        ),
        ([CANCELLER, "radar.frame.n_chirps=3"], "radar.frame.n_chirps: 3, under mitigation"),
    ],
)
def test_rejects_impossible_tracking_settings_before_simulation(street, changes, message):
    with pytest.raises(dc.InvalidFile, match=message):
        dc.load(street, changes)


def test_recording_with_too_few_frames_has_detections_and_a_finding(result, tmp_path):
    from dechirp.recordings.cube_store import write_cube_store

    path = tmp_path / "two.zarr"
    frames = (result.cube.isel(frame=[i]) for i in range(2))
    write_cube_store(path, frames, n_frames=2, radar=result.radar, groups={})
    scenario = dc.Scenario(recording=RecordingSource(path=str(path)), tracker=Tracker())

    short = dc.run(scenario)

    assert short.detections.sizes["detection"] > 0 and short.tracks.sizes["track"] == 0
    (finding,) = [item for item in short.findings if item.setting == "tracker.confirm_after"]
    assert finding.value == "3 detections, in a run of 2 frames: no track is confirmed"
    assert "process at least 3 frames" in finding.fix


@pytest.mark.parametrize(
    "trackers",
    [{}, {"tracker": None, "group_tracker": dc.group_tracking.GroupTracker()}],
    ids=["tracker", "group_tracker"],
)
def test_few_frames_of_a_scene_are_a_finding(result, trackers):
    scenario = replace(result.scenario, n_frames=1, **trackers)

    stage = estimate_ego_motion_clusters_tracks(
        result.detections.isel(detection=result.detections.frame.values == 0).drop_vars(
            ["cluster", "motion"]
        ),
        result.times_s[:1],
        scenario,
        result.radar,
    )

    name = "group_tracker" if trackers else "tracker"
    assert [item.setting for item in stage.findings] == [f"{name}.confirm_after"]


def test_missing_stone_soup_is_reported_before_simulation(result, monkeypatch):
    monkeypatch.delitem(sys.modules, "dechirp.tracking.stone_soup", raising=False)
    for name in [name for name in sys.modules if name.partition(".")[0] == "stonesoup"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, "stonesoup", None)
    progress_calls = []
    with pytest.raises(
        dc.InvalidSetting,
        match=r"^tracker: a tracker without Stone Soup"
        r" .*'dechirp\[track\]",
    ):
        dc.run(result.scenario, progress=lambda n_done, n_total: progress_calls.append(n_done))
    assert not progress_calls


def test_rejects_tracking_settings_of_wrong_type(result):
    for name, value in (("tracker", Dbscan()), ("ego_motion", {})):
        with pytest.raises(dc.InvalidSetting, match=f"Scenario.{name}"):
            replace(result.scenario, **{name: value})


@nightly
def test_group_tracker_follows_detections_in_place_of_tracker(street, tmp_path, capsys):
    changes = ["--set", "tracker=null", "--set", "group_tracker={min_points: 1}"]
    objects = tmp_path / "objects.csv"
    with pytest.raises(SystemExit) as exit_info:
        main(
            [
                "run",
                str(street),
                "--out",
                str(tmp_path / "out"),
                "--objects",
                str(objects),
                *changes,
            ]
        )
    printed = capsys.readouterr()
    assert exit_info.value.code == 0, printed.err
    assert "1 track, last state" in printed.out
    assert "size (m)" in printed.out
    rows = list(csv.DictReader((tmp_path / "out" / "tracks.csv").read_text().splitlines()))
    (last,) = [row for row in rows if row["frame"] == str(N_FRAMES - 1)]
    # 30 m, and 6 m/s relative to the radar for five and a half periods of 50 ms.
    assert float(last["x_m"]) == pytest.approx(31.65, abs=0.3)
    assert float(last["y_m"]) == pytest.approx(1, abs=0.5)
    assert float(last["length_m"]) >= float(last["width_m"]) > 0
    assert int(last["n_points"]) == 1
    assert "Sizes are the axes" in (tmp_path / "out" / "report.html").read_text()
    listed = list(csv.DictReader(objects.read_text().splitlines()))
    assert float(listed[-1]["length_m"]) > 0


def test_groups_that_are_too_small_give_finding(result):
    scenario = replace(
        result.scenario, tracker=None, group_tracker=dc.group_tracking.GroupTracker()
    )
    detections = result.detections.drop_vars(["cluster", "motion"])
    stage = estimate_ego_motion_clusters_tracks(detections, result.times_s, scenario, result.radar)
    assert stage.tracks.sizes["track"] == 0
    assert [finding.setting for finding in stage.findings] == ["group_tracker.min_points"]


def test_rejects_group_tracker_beside_tracker(result):
    with pytest.raises(dc.InvalidSetting, match="Scenario.group_tracker: given beside tracker"):
        replace(result.scenario, group_tracker=dc.group_tracking.GroupTracker())
