"""Angles of detections in the processing chain, in results, tables and reports."""

import json
import re
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console
from test_angle_motion_compensation import HALF_M, make_mimo_radar, make_target

import dechirp as dc
from dechirp.cli.run_output import strongest_detections_table
from dechirp.core.table_columns import COLUMNS, dataset_to_columns, dataset_to_records
from dechirp.core.text import EN_DASH
from dechirp.evaluation.association import associate_detections
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.angle.esprit import Esprit
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood
from dechirp.processing.angle.monopulse import Monopulse
from dechirp.processing.angle.music import Music
from dechirp.processing.direction_finding import (
    phase_centres_m,
    range_and_direction_from_origin,
    range_from_phase_centre_m,
)
from dechirp.processing.near_field import far_field_range_m
from dechirp.radar.calibration import Calibration
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.report.page import render_report
from dechirp.results.text_files import to_json_text
from dechirp.theory.direction_bounds import unit_vectors
from nightly import nightly

TDM_CODE = dc.multiplexing.Tdm(order=(0, 1, 2))
ANGLES = ("azimuth", "elevation", "azimuth_std", "elevation_std")


def test_linear_array_yields_azimuth_without_elevation(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    scene = dc.Scene(targets=[make_target(-20, 3)])
    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)

    assert np.degrees(detections.azimuth.item()) == pytest.approx(-20, abs=0.1)
    assert np.isnan(detections.elevation.item()) and np.isnan(detections.elevation_std.item())
    for name in ANGLES:
        assert detections[name].units == "rad"
    assert detections.ambiguity_number.units == detections.ambiguity_confidence.units == "1"


def test_planar_array_yields_azimuth_and_elevation(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    array = dc.Array(
        tx_m=[(0, 0, 0), (0, 4 * HALF_M, 0), (0, 0, 2 * HALF_M)], rx_m=radar.array.rx_m
    )
    radar = replace(radar, array=array)
    target = dc.Target(position_m=(20, -6, 3), velocity_m_per_s=(4, 1, 0), rcs_m2=10)
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar).isel(detection=0)

    # Five standard errors, and 0.02 degrees for the near field.
    for name in ("azimuth", "elevation"):
        allowed = 5 * float(detections[f"{name}_std"]) + 3e-4
        assert float(detections[name]) == pytest.approx(float(truth[name]), abs=allowed)


@pytest.mark.parametrize("n_rows", [1, 3])
@pytest.mark.parametrize("azimuth_deg", [-50, 40, 60])
def test_directions_of_distant_targets_take_frequency_of_delayed_echo(radar, n_rows, azimuth_deg):
    """The echo has a frequency S tau below that at mid-window: 9.3 MHz at 70 m."""
    rx_m = [(0, y * HALF_M, z * HALF_M) for z in range(n_rows) for y in range(4)]
    radar = replace(radar, array=dc.Array(tx_m=[(0, 0, 0)], rx_m=rx_m))
    elevation_deg = 25 if n_rows > 1 else 0
    position_m = 70 * unit_vectors(*np.radians([[azimuth_deg], [elevation_deg]]))[0]
    scene = dc.Scene(targets=[dc.Target(position_m=tuple(position_m))])
    noise = dc.impairments.WhiteNoise(snr=1e5)
    detections = dc.detect(dc.simulate(scene, radar, impairments=[noise], seed=1), radar)
    truth = dc.truth(scene, radar)

    # Bounds are below 4e-6 rad at 60 degrees and 103 dB after integration. The wavelength at
    # mid-window makes errors of 1.2e-4 tan(angle), 5.5e-5 rad and more.
    for name in ("azimuth", "elevation")[: 1 + (n_rows > 1)]:
        assert detections[name].item() == pytest.approx(truth[name].item(), abs=2e-5), name


@pytest.mark.parametrize("azimuth_deg", [-55, 0, 50])
@pytest.mark.parametrize("centre_m", [-0.08, 0.0, 0.05])
def test_range_refers_to_origin_for_offset_array(radar, azimuth_deg, centre_m):
    radar = make_mimo_radar(radar, TDM_CODE)
    rx_m = tuple((0, y + centre_m, 0) for _, y, _ in radar.array.rx_m)
    tx_m = tuple((0, y + centre_m, 0) for _, y, _ in radar.array.tx_m)
    radar = replace(radar, array=dc.Array(tx_m=tx_m, rx_m=rx_m))
    azimuth = np.radians(azimuth_deg)
    target = dc.Target(
        position_m=(40 * np.cos(azimuth), 40 * np.sin(azimuth), 0),
        velocity_m_per_s=(2, 1, 0),
        rcs_m2=1000,
    )
    scene = dc.Scene(targets=[target])
    true_m = float(dc.truth(scene, radar).range.squeeze())

    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    strongest = detections.isel(detection=int(np.argmax(detections.snr.values)))

    # Five standard errors; the array centre is up to 80 mm nearer or farther.
    error_m = float(strongest.range) - true_m
    assert abs(error_m) < 5 * float(strongest.range_std) + 1e-4


PLANE_TX_M = [(0, 0, 0), (0, 4 * HALF_M, 0), (0, 0, 2 * HALF_M)]
LINE_TX_M = [(0, 4 * HALF_M * k, 0) for k in range(3)]


@pytest.mark.parametrize(
    ("tx_m", "centre_m", "is_vertical"),
    [
        (PLANE_TX_M, (0.1, 0.3, -0.2), False),
        (PLANE_TX_M, (0.0, -0.3, 0.1), False),
        (LINE_TX_M, (0.1, 0.3, 0.0), False),
        (LINE_TX_M, (0.1, 0.0, 0.3), True),
    ],
)
def test_range_and_angles_refer_to_origin_for_distant_array(radar, tx_m, centre_m, is_vertical):
    axis_order = [0, 2, 1] if is_vertical else [0, 1, 2]
    radar, centre = make_mimo_radar(radar, TDM_CODE), np.array(centre_m)
    is_plane = tx_m is PLANE_TX_M
    tx, rx = (np.array(antennas_m)[:, axis_order] for antennas_m in (tx_m, radar.array.rx_m))
    array = dc.Array(tx_m=tx - tx.mean(axis=0) + centre, rx_m=rx - rx.mean(axis=0) + centre)
    radar = replace(radar, array=array)
    # The target is level with the array centre, so the unresolved angle is 0 as assumed.
    position = (7, -3, 1) if is_plane else (7, -3, 0)
    target = dc.Target(position_m=tuple(np.array(position)[axis_order]), rcs_m2=1000)
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    detections = detections.isel(detection=int(np.argmax(detections.snr.values)))

    # Five standard errors, and the curvature of the wave over 23 mm of array: path D^2 / (8 R),
    # over D where transmitters are not symmetric about their centre, which is 0.4 m from the
    # origin. Without the correction, ranges are 0.1 m and angles 2 degrees off.
    curvature_error = 4e-4 if is_plane else 1e-5
    assert abs(detections.range - truth.range) < 5 * detections.range_std + 0.4 * curvature_error
    for name, is_resolved in (("azimuth", not is_vertical), ("elevation", is_vertical or is_plane)):
        assert np.isfinite(detections[name]) == is_resolved
        if is_resolved:
            assert (
                abs(detections[name] - truth[name])
                < 5 * detections[f"{name}_std"] + curvature_error
            )


RX_4_M = tuple((0.0, HALF_M * k, 0.0) for k in range(4))
RX_L_M = (*RX_4_M, *((0.0, 0.0, HALF_M * k) for k in range(1, 5)))


@pytest.mark.parametrize(
    ("tx_m", "rx_m"),
    [
        (((0, 0, 0),), RX_4_M),  # directions from the receivers: 0.08 degrees at 2 m
        (((0, -0.04, 0),), RX_4_M),
        (((0, -1.5 * HALF_M, 0),), RX_4_M),  # the middle of the array is the origin
        (((0.02, 0, 0),), RX_4_M),
        (((0, 0.02, 0),), RX_L_M),
        (((0, -0.02, 0), (0, 4 * HALF_M - 0.02, 0), (0, 8 * HALF_M - 0.02, 0)), RX_4_M),
        (((0, -0.03, 0), (0, 4 * HALF_M - 0.03, 0), (0, -0.03, 2 * HALF_M)), RX_4_M),
    ],
)
def test_directions_of_near_targets_refer_to_origin_for_separate_transmitters(radar, tx_m, rx_m):
    radar = make_mimo_radar(radar, TDM_CODE)
    code = TDM_CODE if len(tx_m) == 3 else None
    frame = replace(radar.frame, multiplexing=code)
    radar = replace(radar, frame=frame, array=dc.Array(tx_m=tx_m, rx_m=rx_m))
    target = dc.Target(position_m=(1.5, 1.3, 0), rcs_m2=10)
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    detections = dc.detect(dc.simulate(scene, radar, impairments=()), radar)
    detections = detections.isel(detection=int(np.argmax(detections.snr.values)))

    # Terms of third order: antennas are up to 50 mm from the middle, (50 mm / 2 m)^2 / 4 = 0.009
    # degrees. From the middle of the array, azimuths are 0.04 to 0.4 degrees off.
    assert abs(detections.azimuth - truth.azimuth) < np.radians(0.009)
    if np.isfinite(detections.elevation):
        assert abs(detections.elevation - truth.elevation) < np.radians(0.009)


def test_move_to_origin_is_inverted_by_range_from_phase_centre(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    tx_m = [(0.1 + x, 0.3 + y, z - 0.2) for x, y, z in PLANE_TX_M]
    radar = replace(radar, array=replace(radar.array, tx_m=tx_m))
    rng = np.random.default_rng(1)
    azimuth, elevation = rng.uniform(-1, 1, (2, 6))
    azimuth[:2], elevation[1:3] = np.nan, np.nan
    ambiguity_number = np.array([0, 0, 0, 0, np.nan, 0])
    range_m = np.array([8.0, 3.0, 2.0, 5.0, 4.0, -0.1])

    centres_m = phase_centres_m(azimuth, elevation, ambiguity_number, radar)
    from_origin = range_and_direction_from_origin(range_m, azimuth, elevation, centres_m)

    np.testing.assert_allclose(
        range_from_phase_centre_m(centres_m, *from_origin), range_m, rtol=1e-13
    )
    # Rows without angle, ambiguity number or position stay unchanged.
    for original, result in zip((range_m, azimuth, elevation), from_origin, strict=True):
        np.testing.assert_array_equal(result[[1, 4, 5]], original[[1, 4, 5]])
        np.testing.assert_array_equal(np.isnan(result), np.isnan(original))
    target_m = radar.element_positions_m.mean(axis=0) / 2 + 5 * unit_vectors(
        azimuth[3], elevation[3]
    )
    np.testing.assert_allclose(
        from_origin[0][3] * unit_vectors(from_origin[1][3], from_origin[2][3]), target_m
    )


def test_single_element_has_no_angle_estimation_by_default(reference, clean):
    detections = dc.detect(clean, reference.radar)

    assert dc.Chain().fit_to_radar(reference.radar).angle is None
    for name in (*ANGLES, "ambiguity_number", "ambiguity_confidence"):
        assert np.isnan(detections[name]).all()


def test_rejects_angle_estimation_with_single_element(radar, reference, clean):
    with pytest.raises(dc.InvalidSetting, match="chain.angle: 1 virtual element") as error:
        dc.detect(clean, reference.radar, dc.Chain(angle=Bartlett()))
    assert error.value.mistakes[0].setting == "chain.angle"
    with pytest.raises(dc.InvalidSetting, match="chain.angle"):
        replace(reference, chain=dc.Chain(angle=Bartlett()))
    with pytest.raises(dc.InvalidSetting, match=r"Chain.angle.* family"):
        dc.Chain(angle="fft")


ROW_M = [(0, HALF_M * k, 0) for k in range(12)]
NONUNIFORM_ROW_M = [(0, 0, 0), (0, HALF_M, 0), (0, 2.37 * HALF_M, 0)]


@pytest.mark.parametrize(
    ("angle", "rx_m", "setting"),
    [
        # Subarrays of eight elements resolve seven sources.
        (Music(n_sources=9), ROW_M, "chain.angle.n_sources"),
        (Esprit(), NONUNIFORM_ROW_M, "chain.angle.kind"),
        (Monopulse(), [(0, 0, 0), (HALF_M, HALF_M, 0)], "chain.angle"),
    ],
)
def test_scenario_rejects_angle_method_unsuited_to_array(reference, angle, rx_m, setting):
    radar = replace(reference.radar, array=dc.Array(rx_m=rx_m))
    with pytest.raises(dc.InvalidSetting) as error:
        replace(reference, radar=radar, chain=dc.Chain(angle=angle))
    assert error.value.mistakes[0].setting == setting


def test_pause_after_each_round_keeps_velocity_and_azimuth(radar):
    code = dc.multiplexing.Tdm(order=(0, 2, 1), pause_s=3e-4)
    radar = make_mimo_radar(radar, code)
    frame = radar.frame
    assert frame.repetition_s == pytest.approx(3 * frame.interval_s + 3e-4)
    assert frame.chirp_starts_s[:4] == pytest.approx(
        [0, frame.interval_s, 2 * frame.interval_s, frame.repetition_s]
    )
    assert frame.max_velocity_m_per_s == pytest.approx(
        frame.chirp.wavelength_m / 4 / frame.repetition_s
    )
    velocity = 0.6 * frame.max_velocity_m_per_s
    cube = dc.simulate(dc.Scene(targets=[make_target(-20, velocity)]), radar, seed=1)

    detections = dc.detect(cube, radar, dc.Chain(angle=Bartlett()))

    strongest = detections.isel(detection=int(detections.snr.values.argmax()))
    assert abs(strongest.velocity.item() - velocity) < 5 * strongest.velocity_std.item()
    error_rad = strongest.azimuth.item() - np.radians(-20)
    assert abs(error_rad) < max(5 * strongest.azimuth_std.item(), np.radians(0.2))


def test_frame_without_detections_has_no_angles(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    cube = dc.simulate(dc.Scene(targets=[make_target(0, 3)]), radar, seed=1)
    for n_sources in (1, 2):
        chain = dc.Chain(angle=MaximumLikelihood(n_sources=n_sources))
        assert dc.detect(cube * 0, radar, chain).sizes["detection"] == 0


def test_nonorthogonal_code_allows_no_angle_estimation(radar):
    radar = make_mimo_radar(radar, PhaseCode(phases_rad=[[0, 1, 2], [0, 1, 2]]))
    assert dc.Chain().fit_to_radar(radar).angle is None
    with pytest.warns(dc.PhysicsWarning, match="not orthogonal"):
        cube = dc.simulate(dc.Scene(targets=[make_target(0, 3)]), radar, seed=1)
    with pytest.raises(dc.InvalidSetting, match="chain.angle: a code of 3 transmitters"):
        dc.detect(cube, radar, dc.Chain(angle=Bartlett()))


def test_two_sources_in_one_cell_are_two_rows_that_divide_snr(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    scene = dc.Scene(
        targets=[
            make_target(-20, 0),
            make_target(25, 0),
            replace(make_target(0, 5), position_m=(45, 0, 0)),
        ]
    )
    cube = dc.simulate(scene, radar, seed=1)
    single_source = dc.detect(cube, radar, dc.Chain(angle=Bartlett()))
    two_sources = dc.detect(cube, radar, dc.Chain(angle=MaximumLikelihood(n_sources=2)))

    pair = two_sources.isel(detection=np.flatnonzero(abs(two_sources.range - 20) < 1))
    assert pair.sizes["detection"] == 2
    assert sorted(np.degrees(pair.azimuth.values)) == pytest.approx([-20, 25], abs=0.2)
    single = single_source.isel(detection=int(abs(single_source.range.values - 20).argmin()))
    assert pair.snr.sum() == pytest.approx(single.snr.item())
    assert (np.diff(pair.snr) <= 0).all()
    # Each row has the standard error of its own share of the SNR.
    assert (pair.range_std.values >= single.range_std.item()).all()
    # With an unknown ambiguity number, both ranges refer to the array centre.
    assert pair.range.values == pytest.approx(np.full(2, single.range.item()))


def test_calibration_applies_to_angles_and_ranges(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    rng = np.random.default_rng(3)
    gain = np.exp(1j * rng.uniform(-np.pi, np.pi, 12))
    cube = dc.simulate(dc.Scene(targets=[make_target(20, 0)]), radar, seed=1)
    uncalibrated_cube = cube.copy()
    uncalibrated_cube.values[0] /= np.tile(gain.reshape(3, 4), (32, 1))[:, :, None]
    calibration = Calibration(
        elements=[(tx, rx) for tx in range(3) for rx in range(4)],
        gain=[(element_gain.real, element_gain.imag) for element_gain in gain],
        range_offset_m=0.25,
    )

    detections = dc.detect(uncalibrated_cube, replace(radar, calibration=calibration)).isel(
        detection=0
    )
    expected = dc.detect(cube, radar).isel(detection=0)
    uncalibrated = dc.detect(uncalibrated_cube, radar).isel(detection=0)

    assert np.degrees(detections.azimuth - expected.azimuth) == pytest.approx(0, abs=1e-3)
    assert (expected.range - detections.range).item() == pytest.approx(0.25)
    assert detections.ambiguity_number == expected.ambiguity_number == 0
    assert abs(np.degrees(uncalibrated.azimuth - expected.azimuth)) > 1


def test_lost_chirps_keep_angles_finite(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    cube = dc.simulate(dc.Scene(targets=[make_target(20, 3)]), radar, seed=1)
    # A block of chirps, and one transmitter for the whole frame.
    for lost_chirps in (slice(10, 40), slice(1, None, 3)):
        incomplete_cube = cube.copy()
        incomplete_cube.values[0, lost_chirps] = 0
        detections = dc.detect(incomplete_cube, radar)
        strongest = detections.isel(detection=int(detections.snr.values.argmax()))

        assert np.isfinite(strongest.azimuth) and np.isfinite(strongest.azimuth_std)
        assert np.degrees(strongest.azimuth.item()) == pytest.approx(20, abs=3)


def test_rejects_nonfinite_samples(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    cube = dc.simulate(dc.Scene(targets=[make_target(20, 3)]), radar, seed=1)
    cube.values[0, 5, 2, 7] = np.nan

    with pytest.raises(dc.InvalidSetting, match="not finite"):
        dc.detect(cube, radar)


def test_table_has_degrees_integer_ambiguity_number_and_null(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    scene = dc.Scene(targets=[make_target(-20, 3)])
    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    (row,) = json.loads(to_json_text(dataset_to_records(detections)))

    assert list(row) == list(COLUMNS)
    assert row["azimuth_deg"] == pytest.approx(np.degrees(detections.azimuth.item()))
    assert row["azimuth_std_deg"] == pytest.approx(np.degrees(detections.azimuth_std.item()))
    assert row["elevation_deg"] is None and row["elevation_std_deg"] is None
    assert (row["ambiguity_number"], type(row["ambiguity_number"])) == (0, int)
    assert dataset_to_columns(
        detections.assign(ambiguity_number=detections.ambiguity_number * np.nan)
    )["ambiguity_number"] == [None]


def test_associates_detections_with_targets_by_azimuth(radar):
    # One transmitter is used: TDM does not resolve the ambiguity of two sources in a cell.
    radar = make_mimo_radar(radar, TDM_CODE)
    rx_m = [(0, HALF_M * k, 0) for k in range(12)]
    frame = replace(radar.frame, multiplexing=None)
    radar = replace(radar, frame=frame, array=dc.Array(rx_m=rx_m))
    left_target, right_target = make_target(30, 0), make_target(-30, 0)
    scene = dc.Scene(
        targets=[replace(left_target, name="left"), replace(right_target, name="right")]
    )
    truth = dc.truth(scene, radar)
    chain = dc.Chain(angle=MaximumLikelihood(n_sources=2))
    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar, chain)

    matches = associate_detections(detections, truth, radar, scene)

    assert detections.sizes["detection"] == 2
    expected = [0 if azimuth > 0 else 1 for azimuth in detections.azimuth.values]
    assert matches.target.tolist() == expected
    assert np.degrees(matches.azimuth_error_rad) == pytest.approx(np.zeros(2), abs=0.2)
    assert np.isnan(matches.elevation_error_rad).all()


@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")
def test_errors_of_aliased_targets_refer_to_reported_ambiguity(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    speed = 1.4 * radar.frame.max_velocity_m_per_s
    scene = dc.Scene(targets=[make_target(20, speed)])
    truth = dc.truth(scene, radar)
    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    single_receiver_radar = replace(radar, array=replace(radar.array, rx_m=[(0, 0, 0)]))
    ambiguous_detections = dc.detect(
        dc.simulate(scene, single_receiver_radar, seed=1), single_receiver_radar
    )

    assert detections.ambiguity_number.item() == 1 and np.isnan(
        ambiguous_detections.ambiguity_number.item()
    )
    for case_detections, case_radar in (
        (detections, radar),
        (ambiguous_detections, single_receiver_radar),
    ):
        matches = associate_detections(case_detections, truth, case_radar, scene)
        assert matches.target.tolist() == [0]
        assert abs(matches.range_error_m[0]) < 0.01
        assert abs(matches.velocity_error_m_per_s[0]) < 0.05
    assert ambiguous_detections.velocity.item() < 0 < detections.velocity.item()


@nightly
def test_report_shows_angles_and_errors_in_degrees(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(targets=[make_target(-20, 3)]))
    result = dc.run(scenario)
    page = render_report(result, yaml="name: scenario\n")

    assert '<th class="num">Azimuth (°)</th><th class="num">SNR (dB)</th>' in page
    assert '<th class="num">Azimuth error (°)</th>' in page
    assert "Elevation error" not in page
    (azimuth_deg,) = (float(np.degrees(value)) for value in result.detections.azimuth.values)
    assert re.search(f"\N{MINUS SIGN}{abs(azimuth_deg):.2f} ±\N{NO-BREAK SPACE}", page)


@nightly
@pytest.mark.parametrize(("range_m", "is_warned"), [(4.0, True), (20.0, False)])
def test_warns_of_target_in_near_field(radar, range_m, is_warned):
    # The far field of 11 elements in 93 mm begins at 2 D^2 / lambda = 4.5 m, where the wave lags by
    # 22.5 degrees at the ends of the array.
    array = dc.Array(rx_m=[(0, 9.3e-3 * k, 0) for k in range(11)])
    radar = replace(radar, array=array)
    result = dc.run(dc.Scenario(radar=radar, scene=dc.Scene(targets=[make_target(5, 2, range_m)])))

    detections = [finding.value for finding in result.findings if "near field" in finding.value]
    assert far_field_range_m(radar) == pytest.approx(4.47, abs=0.02)
    assert bool(detections) == is_warned
    path_difference_m = np.hypot(4.47, 0.0465) - 4.47
    assert 360 * path_difference_m / 3.87e-3 == pytest.approx(22.5, abs=0.3)


@pytest.mark.parametrize("width", [60, 80, 100, 132])
def test_terminal_table_shows_azimuth_within_its_width(radar, width):
    radar = make_mimo_radar(radar, TDM_CODE)
    radar = replace(radar, hardware=replace(radar.hardware, transmit_power_w=0.01))
    targets = [
        replace(make_target(-20, 3), name="car"),
        replace(make_target(31, -2, 45.0), name="truck"),
    ]
    result = dc.run(dc.Scenario(radar=radar, scene=dc.Scene(targets=targets), n_frames=3))

    screen = StringIO()
    Console(width=width, file=screen).print(
        strongest_detections_table(result, at_most=20, width=width)
    )
    lines = screen.getvalue().splitlines()

    assert max(map(len, lines)) <= width
    assert not any("…" in line for line in lines)
    assert any("Range (m)" in line and "target" in line for line in lines)
    azimuth = re.compile("\N{MINUS SIGN}(20|19)[.][0-9]{2,} ±\N{NO-BREAK SPACE}0[.]0[0-9]+")
    beside_truth = re.compile(azimuth.pattern + " +\N{MINUS SIGN}20[.]00")
    assert any(azimuth.search(line) for line in lines) == (width >= 80)
    assert any(beside_truth.search(line) for line in lines) == (width >= 100)
    assert any("SNR (dB)" in line for line in lines) == (width >= 80)


@pytest.mark.parametrize("width", [60, 80, 100, 132])
def test_terminal_table_shows_elevation_of_planar_array(radar, width):
    radar = make_mimo_radar(radar, TDM_CODE)
    array = dc.Array(
        tx_m=[(0, 0, 0), (0, 4 * HALF_M, 0), (0, 0, 2 * HALF_M)], rx_m=radar.array.rx_m
    )
    target = dc.Target(name="car", position_m=(20, -6, 3), rcs_m2=10)
    scenario = dc.Scenario(
        radar=replace(radar, array=array), scene=dc.Scene(targets=[target]), n_frames=3
    )
    screen = StringIO()
    result = dc.run(scenario)
    Console(width=width, file=screen).print(
        strongest_detections_table(result, at_most=20, width=width)
    )
    lines = screen.getvalue().splitlines()

    assert max(map(len, lines)) <= width
    # The elevation is arctan(3 / 20.9) = 8.17 degrees, with an error of 0.001 degrees.
    elevation = re.compile("8[.]1[78] ±\N{NO-BREAK SPACE}<0[.]01")
    assert any(elevation.search(line) for line in lines) == (width >= 80)
    # Range has an error of 0.04 mm, below a hundredth of a cell of 0.29 m: 3 decimals, or 2 where
    # they would displace a column.
    range_m = "21[.]095 ±\N{NO-BREAK SPACE}<0[.]001"
    rounded_range_m = "21[.](09|10) ±\N{NO-BREAK SPACE}<0[.]01"
    assert any(re.search(range_m, line) for line in lines) == (width >= 132)
    assert any(re.search(rounded_range_m, line) for line in lines) == (width < 132)
    assert any("SNR (dB)" in line for line in lines) == (width >= 100)
    assert any("target" in line for line in lines)


@pytest.mark.parametrize("moving", [(0, 1), (0, 0)], ids=["differ", "equal"])
def test_standard_terminal_shows_all_measured_columns(radar, moving):
    detections = dc.detect(dc.simulate(dc.Scene(targets=[make_target(-20, 3)]), radar), radar)
    rows = detections.isel(detection=[0, 0])
    estimates = {"elevation": (8.17, 0.3), "azimuth": (-16.7, 0.2)}
    for name, (value_deg, error_deg) in estimates.items():
        rows[name] = ("detection", np.radians([value_deg, value_deg]))
        rows[f"{name}_std"] = ("detection", np.radians([error_deg, error_deg]))
    rows["moving"] = ("detection", np.array(moving, dtype=float))
    result = dc.run(dc.Scenario(radar=radar, scene=dc.Scene(targets=[make_target(-20, 3)])))
    result = replace(result, detections=rows, truth=None)

    table = strongest_detections_table(result, at_most=20, width=80)

    headings = [column.header for column in table.columns]
    measured = ["Range (m)", "Velocity (m/s)", "Azimuth (°)", "Elevation (°)", "SNR (dB)"]
    assert headings[:5] == measured
    # 78 characters without the column that says the same in all rows.
    assert ("Moving" in headings) == (moving == (0, 1))


@pytest.mark.parametrize(("at_most", "last"), [(3, "Moving"), (4, "frame")])
def test_standard_terminal_shows_motion_before_frame_in_selection(radar, at_most, last):
    scene = dc.Scene(targets=[make_target(-20, 3)])
    result = dc.run(dc.Scenario(radar=radar, scene=scene, n_frames=2))
    rows = result.detections.isel(detection=[0, 0, 0, 0])
    rows["range"] = ("detection", np.array([20.0, 30.0, 40.0, 50.0]))
    for name in ("azimuth", "elevation"):
        rows[name] = ("detection", np.radians([-16.72, 8.17, 8.17, 8.17]))
        rows[f"{name}_std"] = ("detection", np.radians([0.22, 0.22, 0.22, 0.22]))
    rows["moving"] = ("detection", np.array([1.0, 0.0, 0.0, 0.0]))
    result = replace(result, detections=rows, truth=None)

    table = strongest_detections_table(result, at_most=at_most, width=80)

    headings = {column.header for column in table.columns}
    assert headings & {"frame", "Moving"} == {last}
    left_out = {"Moving": "frame", "frame": "moving"}[last]
    assert f"not shown in a width of 80 characters: {left_out}" in str(table.title)


@pytest.mark.parametrize(
    ("moving", "counts"),
    [
        ((1, 0, 0, 0), "1 that moves and 2 others"),
        ((1, 1, 1, 0), "2 that move and 1 other"),
        ((1, np.nan, 0, 0), "1 that moves and 2 others"),
    ],
)
def test_title_of_terminal_table_counts_moving_detections(radar, moving, counts):
    detections = dc.detect(dc.simulate(dc.Scene(targets=[make_target(-20, 3)]), radar), radar)
    rows = detections.isel(detection=[0, 0, 0, 0])
    rows["range"] = ("detection", np.array([20.0, 30.0, 40.0, 50.0]))
    rows["snr"] = ("detection", np.array([40.0, 30.0, 20.0, 10.0]))
    rows["moving"] = ("detection", np.array(moving, dtype=float))
    result = dc.run(dc.Scenario(radar=radar, scene=dc.Scene(targets=[make_target(-20, 3)])))

    table = strongest_detections_table(
        replace(result, detections=rows, truth=None), at_most=3, width=80
    )

    assert f"; 3 shown, {counts}: " in str(table.title)
    is_uncertain = np.isnan(moving).any()
    assert (f"{EN_DASH} under Moving: the motion is uncertain" in str(table.title)) == is_uncertain


def test_empty_scene_yields_no_detections(radar):
    radar = make_mimo_radar(radar, TDM_CODE)
    detections = dc.detect(dc.simulate(dc.Scene(), radar, impairments=()), radar)

    assert detections.sizes["detection"] == 0
    assert set(detections) >= {*ANGLES, "ambiguity_number", "ambiguity_confidence"}
