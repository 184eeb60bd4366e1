"""CommonRoad scenarios as other programs write them: shapes, regions, repeated states."""

import math

import numpy as np
import pytest

import dechirp as dc
from dechirp.traffic.frame_scenes import FrameScenes


def write_scenario(folder, *obstacles):
    path = folder / "scenario.xml"
    path.write_text(
        "<commonRoad commonRoadVersion='2020a' timeStepSize='0.1'>"
        + "".join(obstacles)
        + "</commonRoad>",
        encoding="utf-8",
    )
    return path


def point(x, y, name="point"):
    return f"<{name}><x>{x}</x><y>{y}</y></{name}>"


def polygon(*points):
    return f"<polygon>{''.join(point(*corner) for corner in points)}</polygon>"


def state(name, step, position, heading=0.0, more=""):
    return (
        f"<{name}><position>{position}</position><orientation><exact>{heading}</exact>"
        f"</orientation><time><exact>{step}</exact></time>{more}</{name}>"
    )


def obstacle(shape, *states, tag="dynamicObstacle", kind="car", more=""):
    first, *others = states
    path = f"<trajectory>{''.join(others)}</trajectory>" if others else ""
    return f"<{tag} id='7'><type>{kind}</type><shape>{shape}</shape>{first}{path}{more}</{tag}>"


CAR = "<rectangle><length>4</length><width>2</width></rectangle>"
TURNED = 0.3


def turned_corners(centre, length, width):
    c, s = math.cos(TURNED), math.sin(TURNED)
    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]
    return [
        (
            centre[0] + c * along * length / 2 - s * across * width / 2,
            centre[1] + s * along * length / 2 + c * across * width / 2,
        )
        for along, across in signs
    ]


@pytest.mark.parametrize(
    "shape",
    [
        polygon(*turned_corners((20, 5), 30, 4)),
        polygon(*turned_corners((20, 5), 30, 4)[::-1]),
        polygon(*turned_corners((20, 5), 30, 4)[:2])
        + polygon(*turned_corners((20, 5), 30, 4)[2:4]),
        "<rectangle><length>30</length><width>4</width>"
        f"<orientation>{TURNED}</orientation>{point(20, 5, 'center')}</rectangle>",
    ],
)
def test_box_of_an_obstacle_is_the_smallest_around_its_shapes(tmp_path, shape):
    # The obstacle is at (100, 0), turned to the left by 90 degrees: x of the shape is y.
    text = obstacle(
        shape,
        state("initialState", 0, point(100, 0), math.pi / 2),
        tag="staticObstacle",
        kind="roadBoundary",
    )

    item = dc.open_traffic(write_scenario(tmp_path, text)).objects.isel(object=0, time=0)

    assert (item["x"].item(), item["y"].item()) == (pytest.approx(95), pytest.approx(20))
    assert (item["length"].item(), item["width"].item()) == pytest.approx((30, 4))
    turned = item["heading"].item() - math.pi / 2 - TURNED
    assert math.remainder(turned, math.pi) == pytest.approx(0, abs=1e-9)


def test_polygon_without_area_is_a_thin_wall(tmp_path):
    text = obstacle(
        polygon((0, 0), (6, 8), (3, 4)), state("initialState", 0, point(0, 0)), tag="staticObstacle"
    )

    item = dc.open_traffic(write_scenario(tmp_path, text)).objects.isel(object=0, time=0)

    assert (item["x"].item(), item["y"].item()) == pytest.approx((3, 4))
    assert (item["length"].item(), item["width"].item()) == pytest.approx((10, 0.01))


def test_shape_beside_its_origin_turns_with_the_heading(tmp_path):
    # The origin of the shape is the rear axle, 1.5 m behind the middle.
    shape = CAR.replace("</rectangle>", f"{point(1.5, 0, 'center')}</rectangle>")
    states = [state("initialState", 0, point(10, 0)), state("state", 1, point(10, 0), math.pi / 2)]

    objects = dc.open_traffic(write_scenario(tmp_path, obstacle(shape, *states))).objects

    assert objects["x"].values[0] == pytest.approx([11.5, 10])
    assert objects["y"].values[0] == pytest.approx([0, 1.5])
    assert objects["heading"].values[0] == pytest.approx([0, math.pi / 2])


def test_environment_obstacle_is_a_building_in_the_axes_of_the_file(tmp_path):
    building = (
        "<environmentObstacle id='9'><type>building</type>"
        f"<shape>{polygon((0, 0), (8, 0), (8, 6), (0, 6))}</shape></environmentObstacle>"
    )
    car = obstacle(CAR, state("initialState", 0, point(10, 0)), state("state", 1, point(11, 0)))

    objects = dc.open_traffic(write_scenario(tmp_path, building, car)).objects

    item = objects.isel(object=0)
    assert (item["id"].item(), item["kind"].item()) == (9, "building")
    assert item["is_stationary"].item()
    assert item["x"].values.tolist() == pytest.approx([4, 4])
    assert item["y"].values.tolist() == pytest.approx([3, 3])
    assert (item["length"].item(), item["width"].item()) == pytest.approx((8, 6))


@pytest.mark.parametrize(
    "region",
    [
        "<rectangle><length>0.6</length><width>0.4</width><orientation>-2</orientation>"
        f"{point('{x}', 3, 'center')}</rectangle>",
        f"<circle><radius>1</radius>{point('{x}', 3, 'center')}</circle>",
    ],
)
def test_uncertain_positions_are_the_middle_of_their_regions(tmp_path, region):
    states = [
        state("initialState" if step == 0 else "state", step, region.format(x=10 + step))
        for step in range(3)
    ]

    objects = dc.open_traffic(write_scenario(tmp_path, obstacle(CAR, *states))).objects

    assert objects["x"].values[0] == pytest.approx([10, 11, 12])
    assert objects["y"].values[0] == pytest.approx([3, 3, 3])
    assert (objects["length"].item(), objects["width"].item()) == (4, 2)


def test_initial_state_repeated_in_the_trajectory_counts_once(tmp_path):
    states = [state("initialState", 2, point(10, 0))]
    states += [state("state", step, point(8 + step, 0)) for step in (2, 3)]

    objects = dc.open_traffic(write_scenario(tmp_path, obstacle(CAR, *states))).objects

    assert objects["time"].values == pytest.approx([0.2, 0.3])
    assert objects["x"].values[0] == pytest.approx([10, 11])


def test_contradicting_first_states_are_refused(tmp_path):
    states = [state("initialState", 2, point(10, 0)), state("state", 2, point(12, 0))]

    with pytest.raises(dc.RecordingError, match="object 7 twice at 0.2 s"):
        dc.open_traffic(write_scenario(tmp_path, obstacle(CAR, *states)))


def test_unknown_encoding_is_a_fault_of_the_file(tmp_path):
    path = write_scenario(tmp_path)
    path.write_bytes(b"<?xml version='1.0' encoding='UTF-99'?>" + path.read_bytes())

    with pytest.raises(dc.RecordingError, match="LookupError: unknown encoding: UTF-99"):
        dc.open_traffic(path)


def test_occupancy_sets_are_reported_with_their_objects(tmp_path):
    regions = f"<occupancySet><occupancy><shape>{CAR}</shape></occupancy></occupancySet>"
    text = obstacle(CAR, state("initialState", 0, point(10, 0)), more=regions)

    traffic = dc.open_traffic(write_scenario(tmp_path, text))

    assert traffic.objects.sizes["time"] == 1
    (finding,) = traffic.findings
    assert finding.level == "warning"
    assert "occupancy sets of 1 object are not read: 7" in str(finding)


def test_wall_of_a_polygon_is_where_the_polygon_is(tmp_path, radar):
    wall = obstacle(
        polygon((30, -10), (30.5, -10), (30.5, 10), (30, 10)),
        state("initialState", 0, point(0, 0)),
        tag="staticObstacle",
        kind="roadBoundary",
    )
    moves = [
        state("initialState" if step == 0 else "state", step, point(step, 0)) for step in range(4)
    ]
    ego = obstacle(CAR, *moves).replace("id='7'", "id='8'")

    scenes = FrameScenes(dc.open_traffic(write_scenario(tmp_path, wall, ego)), radar, ego=8)

    (item,) = scenes.objects_in_view(0)
    assert item.is_structure
    # The front of the radar is 2 m before the centre of its car, which moves.
    x_m = item.corners_m[:, 0] + scenes.radar_motion(0).position_m[0]
    assert np.ptp(item.corners_m[:, 1]) == pytest.approx(20)
    assert (x_m.min(), x_m.max()) == pytest.approx((30, 30.5))
