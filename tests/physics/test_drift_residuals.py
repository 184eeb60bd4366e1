"""Residuals of static echoes that drift are no moving targets; angles at limits are unknown."""

import numpy as np
import pytest
from test_angle_motion_compensation import make_mimo_radar

import dechirp as dc
from dechirp.processing.cfar.base import Cells
from dechirp.processing.moving_targets import MovingTargetMap, join_moving_detections

CHAIN = dc.Chain(
    cfar=dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=Cells(range=0, velocity=8),
        n_guard=Cells(range=0, velocity=4),
        false_alarm_probability=1e-6,
    ),
    angle=None,
    moving_targets=MovingTargetMap(),
)


def test_target_slower_than_a_cell_beside_strong_echo_is_no_mover(radar):
    chirp, cell = radar.frame.chirp, radar.frame.velocity_resolution_m_per_s
    near_m = 10 + 1.7 * chirp.range_resolution_m
    plate = dc.Target(position_m=(10, 0, 0), rcs_m2=300.0)
    slow = dc.Target(position_m=(near_m, 0, 0), velocity_m_per_s=(0.1 * cell, 0, 0), rcs_m2=0.1)

    detections = dc.detect(
        dc.simulate(dc.Scene(targets=[plate, slow]), radar, seed=4), radar, CHAIN
    )

    # The mean leaves the change of its phase, 0.6 rad, which peaks at 0.7 cells of velocity.
    assert detections.range.values[0] == pytest.approx(10, abs=0.1)
    assert (detections.moving.values == 0).all()


def make_columns(range_m, velocity, snr):
    return {
        "range": np.array(range_m),
        "velocity": np.array(velocity),
        "velocity_std": np.full(len(velocity), 1e-3),
        "snr": np.array(snr),
    }


@pytest.mark.parametrize(("residual_snr", "moves"), [(1e3, 0), (1e6, 1)])
def test_weak_residual_does_not_mark_a_static_echo_as_moving(radar, residual_snr, moves):
    cell = radar.frame.velocity_resolution_m_per_s
    echo = make_columns([10.0], [0.1 * cell], [4e6])
    residual = make_columns([10.1], [0.5 * cell], [residual_snr])

    joined = join_moving_detections(echo, residual, radar, range_main_lobe_m=0.6)

    assert joined["moving"].tolist() == [moves]


@pytest.mark.parametrize(
    ("velocity_cells", "level_db", "moving"),
    [
        (1.5, -25, [0.0]),  # a drift leaves as much
        (1.5, -15, [0.0, np.nan]),  # a drift or a target
        (1.5, -5, [0.0, 1.0]),
        (2.5, -25, [0.0, 1.0]),  # resolved
    ],
)
def test_weak_rows_within_main_lobe_of_static_echo_are_no_movers(
    radar, velocity_cells, level_db, moving
):
    chirp, cell = radar.frame.chirp, radar.frame.velocity_resolution_m_per_s
    lobe_m = 2 * chirp.range_resolution_m
    row_m = 10 + 2.4 * chirp.range_resolution_m

    joined = join_moving_detections(
        make_columns([10.0], [0.0], [1e6]),
        make_columns([row_m], [velocity_cells * cell], [1e6 * 10 ** (level_db / 10)]),
        radar,
        range_main_lobe_m=lobe_m,
    )

    np.testing.assert_equal(joined["moving"], moving)


@pytest.mark.parametrize(
    ("all_echoes_cells", "moving_cells", "motion"),
    [
        (0.3, None, 0.0),  # static, or too slow for the filter
        (0.9, 0.2, 0.0),  # not the same echo: estimates of slow ones differ by less
        (-3.0, None, np.nan),  # no static echo, but not confirmed
        (-3.0, -3.8, 1.0),  # the filter shifts estimates
    ],
)
def test_only_slow_detections_are_static(radar, all_echoes_cells, moving_cells, motion):
    cell = radar.frame.velocity_resolution_m_per_s
    moving_velocity = [] if moving_cells is None else [moving_cells * cell]

    joined = join_moving_detections(
        make_columns([10.0], [all_echoes_cells * cell], [100.0]),
        make_columns(
            [10.0] * len(moving_velocity), moving_velocity, [100.0] * len(moving_velocity)
        ),
        radar,
        range_main_lobe_m=0.6,
    )

    np.testing.assert_equal(joined["moving"], [motion])


@pytest.mark.parametrize(("n_stds", "moving"), [(0.8, np.nan), (4.8, np.nan), (5.0, 1.0)])
def test_motion_is_unknown_where_the_velocity_may_be_zero(radar, n_stds, moving):
    # Zero exceeds 4.9 standard errors once in 10^6.
    columns = make_columns([10.0], [-1e-3 * n_stds], [3e6])

    joined = join_moving_detections(columns, columns, radar, range_main_lobe_m=0.6)

    np.testing.assert_equal(joined["moving"], [moving])


def test_slow_targets_beside_drifting_echoes_still_move(radar):
    cell = radar.frame.velocity_resolution_m_per_s
    plate = dc.Target(position_m=(10, 0, 0), rcs_m2=300.0)
    walker = dc.Target(position_m=(10.3, 0, 0), velocity_m_per_s=(3 * cell, 0, 0), rcs_m2=1.0)

    detections = dc.detect(
        dc.simulate(dc.Scene(targets=[plate, walker]), radar, seed=4), radar, CHAIN
    )

    (velocity,) = detections.velocity.values[detections.moving.values == 1]
    assert velocity == pytest.approx(3 * cell, abs=0.1 * cell)


def test_angles_at_the_limit_of_the_field_of_view_are_unknown(radar):
    radar = make_mimo_radar(radar, dc.multiplexing.Tdm(order=(0, 1, 2)))
    scene = dc.Scene(
        targets=[
            dc.Target(name="inside", position_m=(20, 5, 0), rcs_m2=10),
            dc.Target(name="beyond", position_m=(30, 26.5, 0), rcs_m2=100),  # 41.5 degrees
        ]
    )
    narrow = dc.Chain(field_of_view=dc.FieldOfView(azimuth_rad=np.radians(40)))
    cube = dc.simulate(scene, radar, seed=1)
    inside, beyond = dc.detect(cube, radar, narrow).sortby("range").azimuth.values[[0, -1]]

    assert np.degrees(inside) == pytest.approx(14.04, abs=0.3)
    assert np.isnan(beyond)

    result = dc.run(dc.Scenario(radar=radar, scene=scene, chain=narrow))
    (note,) = (str(finding) for finding in result.findings if "left unknown" in str(finding))
    assert "chain.field_of_view: an angle of 1 detection is" in note
