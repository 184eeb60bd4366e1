"""Stationary objects of traffic files: kinds, presence, echoes and shadows."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
from test_traffic import write_osi

import dechirp as dc
from dechirp.experiments.traffic_stage import TrafficFrames
from dechirp.scene.shadowing import target_shadow_losses
from dechirp.traffic.frame_scenes import FrameScenes
from dechirp.traffic.true_objects import find_true_objects
from sample_osi_views import make_view

pytest.importorskip("osi3")
RADAR = dc.load(Path(__file__).parents[2] / "examples" / "highway.yaml").radar
# Type, material, place and size of stationary objects.
ROAD = [
    (11, "WALL", "CONCRETE", (40.0, 6.0, 1.5), (60.0, 0.3, 3.0)),
    (12, "BUILDING", "CONCRETE", (60.0, -25.0, 6.0), (20.0, 10.0, 12.0)),
    (13, "BARRIER", "METAL", (50.0, -4.0, 0.375), (0.3, 100.0, 0.75)),
    (14, "BARRIER", "CONCRETE", (50.0, 14.0, 0.4), (20.0, 0.3, 0.8)),
    (15, "POLE", "METAL", (30.0, 4.5, 3.0), (0.15, 0.15, 6.0)),
    (16, "TREE", "WOOD", (45.0, -8.0, 4.0), (4.0, 4.0, 8.0)),
    (17, "VEGETATION", "OTHER", (25.0, -7.0, 0.75), (6.0, 1.0, 1.5)),
    (18, "BRIDGE", "CONCRETE", (2.0, 0.0, 6.0), (10.0, 30.0, 1.0)),
    (19, "OTHER", "OTHER", (35.0, 5.0, 0.25), (1.0, 1.0, 0.5)),
]


def add_stationary(truth, number, type_name, material, position_m, size_m):
    item = truth.stationary_object.add()
    item.id.value = number
    classification, base = item.classification, item.base
    classification.type = getattr(classification, f"TYPE_{type_name}")
    classification.material = getattr(classification, f"MATERIAL_{material}")
    base.position.x, base.position.y, base.position.z = position_m
    base.dimension.length, base.dimension.width, base.dimension.height = size_m
    # The rail of the road is stated across its length.
    base.orientation.yaw = math.pi / 2 if number == 13 else 0.0


def road_views(n=5, structures=ROAD, ahead_m=60.0):
    views = []
    for k in range(n):
        view = make_view(
            0.1 * k,
            {"id": 1, "x": -5 + 1.0 * k, "vx": 10.0, "vy": 0.0},
            {"id": 2, "x": ahead_m + 0.5 * k, "vx": 5.0, "vy": 0.0},
        )
        for structure in structures:
            add_stationary(view.global_ground_truth, *structure)
        views.append(view)
    return views


def test_osi_structures_are_read_by_type_and_material(tmp_path):
    views = road_views()
    del views[0].global_ground_truth.stationary_object[3:]  # present at all times all the same

    traffic = dc.open_traffic(write_osi(tmp_path, views))

    objects = traffic.objects
    kinds = dict(zip(objects["id"].values.tolist(), objects["kind"].values.tolist(), strict=True))
    assert kinds == {
        1: "car", 2: "car", 11: "wall", 12: "building", 13: "guard-rail", 14: "wall", 15: "pole",
        16: "tree", 17: "hedge", 18: "overhead", 19: "wall",
    }  # fmt: skip
    standing = objects.isel(object=objects["is_stationary"].values)
    assert standing["id"].values.tolist() == [structure[0] for structure in ROAD]
    assert np.array_equal(standing["x"], np.repeat([[item[3][0]] for item in ROAD], 5, axis=1))
    rail = objects.isel(object=objects["id"].values.tolist().index(13))
    assert (float(rail["length"]), float(rail["width"])) == (100.0, 0.3)
    assert rail["heading"].values == pytest.approx(np.full(5, math.pi))
    (finding,) = [item for item in traffic.findings if item.setting == "traffic.stationary"]
    assert finding.value == (
        "9 stationary objects: 1 building, 1 guard-rail, 1 hedge, 1 overhead, 1 pole, 1 tree,"
        " 3 wall"
    )


def test_osi_sizes_of_zero_are_unknown_and_flat_areas_are_no_walls(tmp_path):
    # Poles with a radius, and crosswalks, as simulators write them from OpenDRIVE.
    structures = [
        (15, "POLE", "METAL", (30.0, 4.5, 3.0), (0.0, 0.0, 6.0)),
        (19, "OTHER", "OTHER", (35.0, 0.0, 0.0), (4.0, 10.0, 0.0)),
        (20, "OTHER", "OTHER", (25.0, 9.0, 0.0), (0.0, 0.0, 0.0)),
    ]
    views = road_views(structures=structures)
    for view in views:
        view.global_ground_truth.moving_object[1].base.dimension.height = 0.0

    traffic = dc.open_traffic(write_osi(tmp_path, views))

    sizes = traffic.objects[["length", "width", "height"]].to_array().values.T
    assert np.isnan(sizes).tolist() == [
        [False] * 3,
        [False, False, True],
        [True, True, False],
        [False] * 3,
        [True] * 3,
    ]
    assert sizes[3] == pytest.approx([4, 10, 0.01])
    scenes = FrameScenes(traffic, RADAR, ego=1)
    find_car = find_true_objects(scenes, [0])
    assert find_car["visible_share"].values.tolist() == [[1.0]]


def test_structures_have_bodies_and_are_no_objects_to_detect(tmp_path):
    traffic = dc.open_traffic(write_osi(tmp_path, road_views()))
    scenes = FrameScenes(traffic, RADAR, ego=1)

    scene = scenes.scene(0)

    kinds = {target.name: target.body.kind() for target in scene.targets}
    assert kinds == {
        "car-2": "car", "wall-11": "wall", "building-12": "wall", "guard-rail-13": "guard-rail",
        "wall-14": "wall", "pole-15": "pole", "tree-16": "foliage", "hedge-17": "foliage",
        "overhead-18": "wall", "wall-19": "wall",
    }  # fmt: skip
    # The radar passes below the bridge, whose deck begins 5.5 m above the road, and its own height
    # is 0.5 m.
    bridge = scene.find_target("overhead-18")
    assert bridge.position_m[2] == pytest.approx(5.0)
    assert not [item for item in scenes.findings if item.setting == "traffic.mount"]
    objects = find_true_objects(scenes, [0])
    assert objects["target"].values.tolist() == ["car-2"]
    assert objects["visible_share"].values.tolist() == [[1.0]]


def test_wall_across_the_road_hides_and_shadows_a_car(tmp_path):
    wall = (11, "WALL", "CONCRETE", (30.0, 0.0, 2.0), (0.3, 40.0, 4.0))
    traffic = dc.open_traffic(write_osi(tmp_path, road_views(structures=[wall])))
    scenes = FrameScenes(traffic, RADAR, ego=1)
    scene = scenes.scene(0)

    (losses,) = target_shadow_losses(scene, np.zeros(1), RADAR.frame.chirp.wavelength_m)

    # The upper edge is 3.5 m above the radar at 32.6 m, before a car at 60.6 m: its depth below
    # the edge is at least 3.5 - 1 * 32.6 / 60.6 m, v > 14, and J(14) > 35 dB each way (P.526).
    assert 10 * np.log10(losses[scene.names.index("car-2")]) > 70
    assert find_true_objects(scenes, [0])["visible_share"].values.tolist() == [[0.0]]


def test_echo_of_a_pole_is_at_its_place_and_level(tmp_path):
    pole = (15, "POLE", "METAL", (30.0, 4.5, 3.0), (0.16, 0.16, 6.0))
    views = road_views(structures=[pole], ahead_m=500.0)
    scenes = FrameScenes(dc.open_traffic(write_osi(tmp_path, views)), RADAR, ego=1)
    radar = RADAR.for_frame(0)

    detections = dc.detect(dc.simulate(scenes.scene(0), radar, seed=1), radar, dc.Chain())

    strongest = detections.isel(detection=int(detections["snr"].values.argmax()))
    mid_s = scenes.mid_frame_s(0)
    x_m, y_m = 30.0 + 5 - 2.25 - 10 * mid_s, 4.5
    range_m = math.hypot(x_m, y_m)
    # The rows of 0.5 m spread the echo over the height: 0.3 m at 33 m is 1 mm of range.
    assert float(strongest["range"]) == pytest.approx(range_m, abs=0.02)
    assert float(strongest["velocity"]) == pytest.approx(-10 * x_m / range_m, abs=0.02)


# The bridge reaches behind antennas without a pattern.
@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")
def test_views_and_traces_give_equal_structures(tmp_path):
    views = road_views(n=3)
    scenes = FrameScenes(dc.open_traffic(write_osi(tmp_path, views)), RADAR, ego=1)
    model = dc.SensorModel(RADAR)

    step = model.measure(views[0])

    mid_s = RADAR.frame.mid_frame_s
    traced = scenes.scene(0)
    for name in traced.names:
        target, viewed = traced.find_target(name), step.scene.find_target(name)
        assert viewed.body == target.body or name == "car-2"
        if name != "car-2":  # the trace's frame is half a frame later
            moved_m = np.subtract(target.position_m, viewed.position_m)
            assert moved_m == pytest.approx((-10 * mid_s, 0.0, 0.0), abs=1e-6)
    assert any(item.setting == "view.stationary" for item in step_findings(model))


def step_findings(model):
    return [item for item in model.findings if "9 stationary objects" in item.value]


def test_long_wall_is_cut_to_the_largest_range(tmp_path):
    wall = (11, "WALL", "CONCRETE", (400.0, 6.0, 1.5), (5000.0, 0.3, 3.0))
    views = road_views(structures=[wall])
    scenes = FrameScenes(dc.open_traffic(write_osi(tmp_path, views)), RADAR, ego=1)
    max_range_m = RADAR.frame.chirp.max_range_m

    target = scenes.scene(0).find_target("wall-11")

    assert 2 * max_range_m <= target.body.length_m <= 2 * max_range_m + 8
    ends_m = target.position_m[0] + np.array([-0.5, 0.5]) * target.body.length_m
    assert ends_m[0] <= -max_range_m and ends_m[1] >= max_range_m
    # The ends are multiples of 4 m from the middle of the wall.
    from_middle_m = ends_m - (400.0 - (-5 + 2.25))
    assert from_middle_m == pytest.approx(4 * np.round(from_middle_m / 4), abs=1e-6)


def test_static_obstacles_of_common_road_are_present_at_all_times(tmp_path):
    path = tmp_path / "scenario.xml"
    states = "".join(
        f"<state><position><point><x>{k}</x><y>0</y></point></position><orientation><exact>0"
        f"</exact></orientation><time><exact>{k}</exact></time></state>"
        for k in range(1, 10)
    )
    path.write_text(
        '<commonRoad commonRoadVersion="2020a" timeStepSize="0.1"><dynamicObstacle id="1">'
        "<type>car</type><shape><rectangle><length>4</length><width>2</width></rectangle></shape>"
        "<initialState><position><point><x>0</x><y>0</y></point></position><orientation><exact>0"
        f"</exact></orientation><time><exact>0</exact></time></initialState><trajectory>{states}"
        "</trajectory></dynamicObstacle>"
        + "".join(
            f'<staticObstacle id="{number}"><type>{kind}</type><shape><rectangle><length>4</length>'
            f"<width>2</width></rectangle></shape><initialState><position><point><x>30</x><y>{y}</y>"
            "</point></position><orientation><exact>0</exact></orientation><time><exact>0</exact>"
            "</time></initialState></staticObstacle>"
            for number, kind, y in ((2, "parkedVehicle", 0), (3, "building", 9), (4, "pillar", -5))
        )
        + "</commonRoad>",
        encoding="utf-8",
    )

    scenes = FrameScenes(dc.open_traffic(path), RADAR, ego=1)

    for number in (0, scenes.n_frames - 1):
        assert scenes.scene(number).names == ("car-2", "building-3", "pole-4")
    # A parked car is a road user, structures are none.
    assert find_true_objects(scenes, [0])["target"].values.tolist() == ["car-2"]


def test_scores_leave_structures_out(tmp_path):
    path = write_osi(tmp_path, road_views(ahead_m=25.0))
    scenario = dc.traffic.traffic_scenario(
        path, ["traffic.ego=1", "traffic.duration=0.11 s", "radar.frame.n_chirps=64"]
    )

    objects = dc.run(scenario).traffic

    assert objects["target"].values.tolist() == ["car-2"]
    assert (objects["n_detections"].values > 0).all()
    assert "pole-15" in TrafficFrames(scenario).scenes.scene(0).names


def test_recorded_trace_has_no_stationary_objects():
    folder = os.environ.get("DECHIRP_WITNESS_DATA")
    if folder is None:
        pytest.skip("set DECHIRP_WITNESS_DATA to the folder of the recorded traces")
    for name in (
        "osi_traces/20230621T113737Z_sv_350_32112_100.osi",
        "commonroad_us101/USA_US101-4_1_T-1.xml",
    ):
        traffic = dc.open_traffic(Path(folder) / name)
        assert not traffic.objects["is_stationary"].values.any()
        assert not [item for item in traffic.findings if item.setting == "traffic.stationary"]
