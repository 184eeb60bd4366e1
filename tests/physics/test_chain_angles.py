"""What the chain makes of an array: angles with every detection, in Python and in tables."""

import json
import re
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console
from test_angle_of_moving_targets import HALF_M, at, mimo

import dechirp as dc
from dechirp.cli.run_output import detections_table
from dechirp.core.table_columns import COLUMNS, dataset_to_columns, dataset_to_records
from dechirp.evaluation.association import associate_detections
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.angle.esprit import Esprit
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood
from dechirp.processing.angle.monopulse import Monopulse
from dechirp.processing.angle.music import Music
from dechirp.processing.direction_finding import (
    move_to_origin,
    phase_centres_m,
    range_from_phase_centre_m,
)
from dechirp.processing.near_field import far_field_range_m
from dechirp.radar.calibration import Calibration
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.report.page import render_report
from dechirp.results.tables import json_text
from dechirp.theory.direction_bounds import unit_vectors

TDM = dc.multiplexing.Tdm(order=(0, 1, 2))
ANGLES = ("azimuth", "elevation", "azimuth_std", "elevation_std")


def test_a_row_of_elements_tells_azimuth_and_no_elevation(radar):
    radar = mimo(radar, TDM)
    found = dc.detect(dc.simulate(dc.Scene(targets=[at(-20, 3)]), radar, seed=1), radar)

    assert np.degrees(found.azimuth.item()) == pytest.approx(-20, abs=0.1)
    assert np.isnan(found.elevation.item()) and np.isnan(found.elevation_std.item())
    for name in ANGLES:
        assert found[name].units == "rad"
    assert found.ambiguity_number.units == found.ambiguity_confidence.units == "1"


def test_a_plane_tells_azimuth_and_elevation(radar):
    radar = mimo(radar, TDM)
    array = dc.Array(
        tx_m=[(0, 0, 0), (0, 4 * HALF_M, 0), (0, 0, 2 * HALF_M)], rx_m=radar.array.rx_m
    )
    radar = replace(radar, array=array)
    target = dc.Target(position_m=(20, -6, 3), velocity_m_per_s=(4, 1, 0), rcs_m2=10)
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    found = dc.detect(dc.simulate(scene, radar, seed=1), radar).isel(detection=0)

    # Five standard errors, and 0.02 degrees for the near field.
    for name in ("azimuth", "elevation"):
        allowed = 5 * float(found[f"{name}_std"]) + 3e-4
        assert float(found[name]) == pytest.approx(float(truth[name]), abs=allowed)


@pytest.mark.parametrize("azimuth_deg", [-55, 0, 50])
@pytest.mark.parametrize("middle_m", [-0.08, 0.0, 0.05])
def test_ranges_are_from_the_origin_wherever_the_array_is(radar, azimuth_deg, middle_m):
    radar = mimo(radar, TDM)
    moved = tuple((0, y + middle_m, 0) for _, y, _ in radar.array.rx_m)
    tx_moved = tuple((0, y + middle_m, 0) for _, y, _ in radar.array.tx_m)
    radar = replace(radar, array=dc.Array(tx_m=tx_moved, rx_m=moved))
    azimuth = np.radians(azimuth_deg)
    target = dc.Target(
        position_m=(40 * np.cos(azimuth), 40 * np.sin(azimuth), 0),
        velocity_m_per_s=(2, 1, 0),
        rcs_m2=1000,
    )
    scene = dc.Scene(targets=[target])
    true_m = float(dc.truth(scene, radar).range.squeeze())

    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    strongest = found.isel(detection=int(np.argmax(found.snr.values)))

    # Five standard errors; the middle of the array is up to 80 mm nearer or farther.
    error_m = float(strongest.range) - true_m
    assert abs(error_m) < 5 * float(strongest.range_std) + 1e-4


PLANE_TX_M = [(0, 0, 0), (0, 4 * HALF_M, 0), (0, 0, 2 * HALF_M)]
LINE_TX_M = [(0, 4 * HALF_M * k, 0) for k in range(3)]


@pytest.mark.parametrize(
    ("tx_m", "middle_m", "upright"),
    [
        (PLANE_TX_M, (0.1, 0.3, -0.2), False),
        (PLANE_TX_M, (0.0, -0.3, 0.1), False),
        (LINE_TX_M, (0.1, 0.3, 0.0), False),
        (LINE_TX_M, (0.1, 0.0, 0.3), True),
    ],
)
def test_places_are_from_the_origin_however_far_off_the_array_is(radar, tx_m, middle_m, upright):
    turn = [0, 2, 1] if upright else [0, 1, 2]
    radar, middle = mimo(radar, TDM), np.array(middle_m)
    is_plane = tx_m is PLANE_TX_M
    tx, rx = (np.array(of)[:, turn] for of in (tx_m, radar.array.rx_m))
    array = dc.Array(tx_m=tx - tx.mean(axis=0) + middle, rx_m=rx - rx.mean(axis=0) + middle)
    radar = replace(radar, array=array)
    # On the level of a line, from its middle: the other angle is 0, as it is taken to be.
    position = (7, -3, 1) if is_plane else (7, -3, 0)
    target = dc.Target(position_m=tuple(np.array(position)[turn]), rcs_m2=1000)
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    found = found.isel(detection=int(np.argmax(found.snr.values)))

    # Five standard errors, and the bend of a wave over 23 mm of array: D^2 / 8 R of path, over D
    # where transmitters are not even about their middle, which is 0.4 m from the origin: without
    # it ranges would be 0.1 m off, and angles 2 degrees.
    bent = 4e-4 if is_plane else 1e-5
    assert abs(found.range - truth.range) < 5 * found.range_std + 0.4 * bent
    for name, is_told in (("azimuth", not upright), ("elevation", upright or is_plane)):
        assert np.isfinite(found[name]) == is_told
        if is_told:
            assert abs(found[name] - truth[name]) < 5 * found[f"{name}_std"] + bent


def test_ranges_and_directions_go_to_the_origin_and_back(radar):
    radar = mimo(radar, TDM)
    tx_m = [(0.1 + x, 0.3 + y, z - 0.2) for x, y, z in PLANE_TX_M]
    radar = replace(radar, array=replace(radar.array, tx_m=tx_m))
    rng = np.random.default_rng(1)
    azimuth, elevation = rng.uniform(-1, 1, (2, 6))
    azimuth[:2], elevation[1:3] = np.nan, np.nan
    fold = np.array([0, 0, 0, 0, np.nan, 0])
    seen_m = np.array([8.0, 3.0, 2.0, 5.0, 4.0, -0.1])

    middle = phase_centres_m(azimuth, elevation, fold, radar)
    placed = move_to_origin(seen_m, azimuth, elevation, middle)

    np.testing.assert_allclose(range_from_phase_centre_m(middle, *placed), seen_m, rtol=1e-13)
    # No angle, no fold or no place: as it was.
    for was, now in zip((seen_m, azimuth, elevation), placed, strict=True):
        np.testing.assert_array_equal(now[[1, 4, 5]], was[[1, 4, 5]])
        np.testing.assert_array_equal(np.isnan(now), np.isnan(was))
    at_m = radar.element_positions_m.mean(axis=0) / 2 + 5 * unit_vectors(azimuth[3], elevation[3])
    np.testing.assert_allclose(placed[0][3] * unit_vectors(placed[1][3], placed[2][3]), at_m)


def test_one_element_tells_no_angle_and_is_not_asked_by_default(reference, clean):
    found = dc.detect(clean, reference.radar)

    assert dc.Chain().fit_to_radar(reference.radar).angle is None
    for name in (*ANGLES, "ambiguity_number", "ambiguity_confidence"):
        assert np.isnan(found[name]).all()


def test_one_element_that_is_asked_for_angles_is_refused(radar, reference, clean):
    with pytest.raises(dc.InvalidSetting, match="chain.angle: 1 virtual element") as wrong:
        dc.detect(clean, reference.radar, dc.Chain(angle=Bartlett()))
    assert wrong.value.mistakes[0].setting == "chain.angle"
    with pytest.raises(dc.InvalidSetting, match="chain.angle"):
        replace(reference, chain=dc.Chain(angle=Bartlett()))
    with pytest.raises(dc.InvalidSetting, match=r"Chain.angle.* family"):
        dc.Chain(angle="fft")


ROW_M = [(0, HALF_M * k, 0) for k in range(12)]
UNEVEN_M = [(0, 0, 0), (0, HALF_M, 0), (0, 2.37 * HALF_M, 0)]


@pytest.mark.parametrize(
    ("angle", "rx_m", "setting"),
    [
        # Windows of eight elements part seven sources.
        (Music(n_sources=9), ROW_M, "chain.angle.n_sources"),
        (Esprit(), UNEVEN_M, "chain.angle.kind"),
        (Monopulse(), [(0, 0, 0), (HALF_M, HALF_M, 0)], "chain.angle"),
    ],
)
def test_what_an_array_does_not_allow_is_refused_with_the_scenario(reference, angle, rx_m, setting):
    radar = replace(reference.radar, array=dc.Array(rx_m=rx_m))
    with pytest.raises(dc.InvalidSetting) as wrong:
        replace(reference, radar=radar, chain=dc.Chain(angle=angle))
    assert wrong.value.mistakes[0].setting == setting


def test_a_frame_without_detections_has_no_angles(radar):
    radar = mimo(radar, TDM)
    cube = dc.simulate(dc.Scene(targets=[at(0, 3)]), radar, seed=1)
    for n_sources in (1, 2):
        chain = dc.Chain(angle=MaximumLikelihood(n_sources=n_sources))
        assert dc.detect(cube * 0, radar, chain).sizes["detection"] == 0


def test_codes_that_do_not_part_the_transmitters_tell_no_angle(radar):
    radar = mimo(radar, PhaseCode(phases_rad=[[0, 1, 2], [0, 1, 2]]))
    assert dc.Chain().fit_to_radar(radar).angle is None
    with pytest.warns(dc.PhysicsWarning, match="not orthogonal"):
        cube = dc.simulate(dc.Scene(targets=[at(0, 3)]), radar, seed=1)
    with pytest.raises(dc.InvalidSetting, match="chain.angle: a code of 3 transmitters"):
        dc.detect(cube, radar, dc.Chain(angle=Bartlett()))


def test_two_sources_in_a_cell_are_two_rows_that_share_the_ratio(radar):
    radar = mimo(radar, TDM)
    scene = dc.Scene(targets=[at(-20, 0), at(25, 0), replace(at(0, 5), position_m=(45, 0, 0))])
    cube = dc.simulate(scene, radar, seed=1)
    one = dc.detect(cube, radar, dc.Chain(angle=Bartlett()))
    two = dc.detect(cube, radar, dc.Chain(angle=MaximumLikelihood(n_sources=2)))

    near = two.isel(detection=np.flatnonzero(abs(two.range - 20) < 1))
    assert near.sizes["detection"] == 2
    assert sorted(np.degrees(near.azimuth.values)) == pytest.approx([-20, 25], abs=0.2)
    of_one = one.isel(detection=int(abs(one.range.values - 20).argmin()))
    assert near.snr.sum() == pytest.approx(of_one.snr.item())
    assert (np.diff(near.snr) <= 0).all()
    # Each row has the standard error of its own share.
    assert (near.range_std.values >= of_one.range_std.item()).all()
    # Of a fold that is not known ranges are from the middle of the array, for both alike.
    assert near.range.values == pytest.approx(np.full(2, of_one.range.item()))


def test_a_calibration_is_applied_to_angles_and_ranges(radar):
    radar = mimo(radar, TDM)
    rng = np.random.default_rng(3)
    gain = np.exp(1j * rng.uniform(-np.pi, np.pi, 12))
    cube = dc.simulate(dc.Scene(targets=[at(20, 0)]), radar, seed=1)
    spoilt = cube.copy()
    spoilt.values[0] /= np.tile(gain.reshape(3, 4), (32, 1))[:, :, None]
    calibration = Calibration(
        elements=[(tx, rx) for tx in range(3) for rx in range(4)],
        gain=[(one.real, one.imag) for one in gain],
        range_offset_m=0.25,
    )

    found = dc.detect(spoilt, replace(radar, calibration=calibration)).isel(detection=0)
    plain = dc.detect(cube, radar).isel(detection=0)
    wrong = dc.detect(spoilt, radar).isel(detection=0)

    assert np.degrees(found.azimuth - plain.azimuth) == pytest.approx(0, abs=1e-3)
    assert (plain.range - found.range).item() == pytest.approx(0.25)
    assert found.ambiguity_number == plain.ambiguity_number == 0
    assert abs(np.degrees(wrong.azimuth - plain.azimuth)) > 1


def test_lost_chirps_leave_angles_finite(radar):
    radar = mimo(radar, TDM)
    cube = dc.simulate(dc.Scene(targets=[at(20, 3)]), radar, seed=1)
    # A run of chirps, and one transmitter for all of the frame.
    for lost in (slice(10, 40), slice(1, None, 3)):
        gappy = cube.copy()
        gappy.values[0, lost] = 0
        found = dc.detect(gappy, radar)
        strongest = found.isel(detection=int(found.snr.values.argmax()))

        assert np.isfinite(strongest.azimuth) and np.isfinite(strongest.azimuth_std)
        assert np.degrees(strongest.azimuth.item()) == pytest.approx(20, abs=3)


def test_samples_that_are_not_finite_are_refused(radar):
    radar = mimo(radar, TDM)
    cube = dc.simulate(dc.Scene(targets=[at(20, 3)]), radar, seed=1)
    cube.values[0, 5, 2, 7] = np.nan

    with pytest.raises(dc.InvalidSetting, match="not finite"):
        dc.detect(cube, radar)


def test_tables_have_degrees_and_whole_folds_and_null_for_none(radar):
    radar = mimo(radar, TDM)
    found = dc.detect(dc.simulate(dc.Scene(targets=[at(-20, 3)]), radar, seed=1), radar)
    (row,) = json.loads(json_text(dataset_to_records(found)))

    assert list(row) == list(COLUMNS)
    assert row["azimuth_deg"] == pytest.approx(np.degrees(found.azimuth.item()))
    assert row["azimuth_std_deg"] == pytest.approx(np.degrees(found.azimuth_std.item()))
    assert row["elevation_deg"] is None and row["elevation_std_deg"] is None
    assert (row["ambiguity_number"], type(row["ambiguity_number"])) == (0, int)
    assert dataset_to_columns(found.assign(ambiguity_number=found.ambiguity_number * np.nan))[
        "ambiguity_number"
    ] == [None]


def test_detections_belong_to_targets_in_their_direction(radar):
    # Receivers in a row: of two sources in a cell, turns tell no certain fold.
    radar = mimo(radar, TDM)
    rx_m = [(0, HALF_M * k, 0) for k in range(12)]
    frame = replace(radar.frame, multiplexing=None)
    radar = replace(radar, frame=frame, array=dc.Array(rx_m=rx_m))
    left, right = at(30, 0), at(-30, 0)
    scene = dc.Scene(targets=[replace(left, name="left"), replace(right, name="right")])
    truth = dc.truth(scene, radar)
    chain = dc.Chain(angle=MaximumLikelihood(n_sources=2))
    found = dc.detect(dc.simulate(scene, radar, seed=1), radar, chain)

    matched = associate_detections(found, truth, radar, scene)

    assert found.sizes["detection"] == 2
    expected = [0 if azimuth > 0 else 1 for azimuth in found.azimuth.values]
    assert matched.target.tolist() == expected
    assert np.degrees(matched.azimuth_error_rad) == pytest.approx(np.zeros(2), abs=0.2)
    assert np.isnan(matched.elevation_error_rad).all()


@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")
def test_errors_of_folded_targets_are_against_what_was_told_of_them(radar):
    radar = mimo(radar, TDM)
    speed = 1.4 * radar.frame.max_velocity_m_per_s
    scene = dc.Scene(targets=[at(20, speed)])
    truth = dc.truth(scene, radar)
    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    alone = replace(radar, array=replace(radar.array, rx_m=[(0, 0, 0)]))
    untold = dc.detect(dc.simulate(scene, alone, seed=1), alone)

    assert found.ambiguity_number.item() == 1 and np.isnan(untold.ambiguity_number.item())
    for detections, of in ((found, radar), (untold, alone)):
        matched = associate_detections(detections, truth, of, scene)
        assert matched.target.tolist() == [0]
        assert abs(matched.range_error_m[0]) < 0.01
        assert abs(matched.velocity_error_m_per_s[0]) < 0.05
    assert untold.velocity.item() < 0 < found.velocity.item()


def test_the_page_shows_angles_beside_the_truth_in_degrees(radar):
    radar = mimo(radar, TDM)
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(targets=[at(-20, 3)]))
    result = dc.run(scenario)
    page = render_report(result, yaml="name: scenario\n")

    assert '<th class="num">Azimuth (°)</th><th class="num">SNR (dB)</th>' in page
    assert '<th class="num">Azimuth error (°)</th>' in page
    assert "Elevation error" not in page
    (one,) = (float(np.degrees(value)) for value in result.detections.azimuth.values)
    assert re.search(f"\N{MINUS SIGN}{int(100 * abs(one)) / 100}[0-9]* ±\N{NO-BREAK SPACE}", page)


@pytest.mark.parametrize(("range_m", "is_told"), [(4.0, True), (20.0, False)])
def test_what_is_in_the_near_field_is_told(radar, range_m, is_told):
    # 11 elements in 93 mm: 2 D^2 / lambda is 4.5 m, where the ends of the array see a wave
    # 22.5 degrees behind the middle.
    array = dc.Array(rx_m=[(0, 9.3e-3 * k, 0) for k in range(11)])
    radar = replace(radar, array=array)
    result = dc.run(dc.Scenario(radar=radar, scene=dc.Scene(targets=[at(5, 2, range_m)])))

    found = [finding.value for finding in result.findings if "near field" in finding.value]
    assert far_field_range_m(radar) == pytest.approx(4.47, abs=0.02)
    assert bool(found) == is_told
    late = np.hypot(4.47, 0.0465) - 4.47
    assert 360 * late / 3.87e-3 == pytest.approx(22.5, abs=0.3)


@pytest.mark.parametrize("width", [60, 80, 100, 132])
def test_the_terminal_shows_angles_within_its_width(radar, width):
    radar = mimo(radar, TDM)
    radar = replace(radar, hardware=replace(radar.hardware, transmit_power_w=0.01))
    targets = [replace(at(-20, 3), name="car"), replace(at(31, -2, 45.0), name="truck")]
    result = dc.run(dc.Scenario(radar=radar, scene=dc.Scene(targets=targets), n_frames=3))

    screen = StringIO()
    Console(width=width, file=screen).print(detections_table(result, at_most=20, width=width))
    lines = screen.getvalue().splitlines()

    assert max(map(len, lines)) <= width
    assert not any("…" in line for line in lines)
    assert any("range, m" in line and "target" in line for line in lines)
    azimuth = re.compile("\N{MINUS SIGN}(20|19)[.][0-9]{2} ± 0[.]0[0-9]")
    beside_truth = re.compile(azimuth.pattern + " +\N{MINUS SIGN}20[.]00")
    assert any(azimuth.search(line) for line in lines) == (width >= 80)
    assert any(beside_truth.search(line) for line in lines) == (width >= 100)
    assert any("SNR, dB" in line for line in lines) == (width >= 100)


@pytest.mark.parametrize("width", [60, 80, 100, 132])
def test_the_terminal_shows_elevations_that_a_plane_tells(radar, width):
    radar = mimo(radar, TDM)
    array = dc.Array(
        tx_m=[(0, 0, 0), (0, 4 * HALF_M, 0), (0, 0, 2 * HALF_M)], rx_m=radar.array.rx_m
    )
    target = dc.Target(name="car", position_m=(20, -6, 3), rcs_m2=10)
    scenario = dc.Scenario(
        radar=replace(radar, array=array), scene=dc.Scene(targets=[target]), n_frames=3
    )
    screen = StringIO()
    result = dc.run(scenario)
    Console(width=width, file=screen).print(detections_table(result, at_most=20, width=width))
    lines = screen.getvalue().splitlines()

    assert max(map(len, lines)) <= width
    # 8.2 degrees up, to a tenth.
    elevation = re.compile("8[.][12][0-9]* ± 0[.]0[0-9]")
    assert any(elevation.search(line) for line in lines) == (width >= 80)
    assert any("target" in line for line in lines)


def test_a_frame_in_which_nothing_is_has_no_rows(radar):
    radar = mimo(radar, TDM)
    found = dc.detect(dc.simulate(dc.Scene(), radar, impairments=()), radar)

    assert found.sizes["detection"] == 0
    assert set(found) >= {*ANGLES, "ambiguity_number", "ambiguity_confidence"}
