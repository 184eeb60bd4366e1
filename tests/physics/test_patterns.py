"""How antennas see directions: gains, beamwidths, tables, and the power they make of an echo."""

import math
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump
from dechirp.config.loading import parse_settings
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.experiments.link_budget import link_budget
from dechirp.radar.angle_table import interpolate_angle_table
from dechirp.radar.budget import echo_amplitude, received_power_w, sample_snr
from dechirp.radar.hardware import Hardware
from dechirp.radar.patterns.cosine import CosinePattern
from dechirp.radar.patterns.patch_array import PatchArray
from dechirp.radar.patterns.table import TablePattern

DEG = math.pi / 180
COSINE = CosinePattern(azimuth_beamwidth_rad=60 * DEG, elevation_beamwidth_rad=12 * DEG)
TABLE = TablePattern(
    azimuth_rad=[-60 * DEG, -20 * DEG, 0, 30 * DEG, 60 * DEG],
    elevation_rad=[-10 * DEG, 0, 10 * DEG],
    gain=[
        [0.01, 1.0, 3.0, 0.5, 0.02],
        [0.02, 5.0, 20.0, 4.0, 0.05],
        [0.01, 2.0, 6.0, 1.0, 0.03],
    ],
)
COLUMN = PatchArray(n_patches=20, design_frequency_hz=77e9)
TILTED = replace(COLUMN, n_patches=12, tilt_rad=10 * DEG)
TAPERED = replace(COLUMN, n_patches=8, taper=(0.2, 0.5, 0.8, 1, 1, 0.8, 0.5, 0.2))
SMOOTH = {"cosine": COSINE, "column": COLUMN, "tilted": TILTED, "tapered": TAPERED}
ALL = {**SMOOTH, "table": TABLE}


def mean_over_the_sphere(pattern, n=200):
    """Mean gain over all directions: Gauss in the sine of elevation, equal steps of azimuth."""
    up, weight = np.polynomial.legendre.leggauss(n)
    azimuth = (np.arange(2 * n) + 0.5) * math.pi / n
    gain = pattern.gain_towards(azimuth, np.arcsin(up)[:, None])
    return float(weight @ gain.mean(axis=1)) / 2


@pytest.mark.parametrize("turned", [0.0, 25 * DEG])
@pytest.mark.parametrize("pattern", SMOOTH.values(), ids=SMOOTH)
def test_an_antenna_without_loss_radiates_what_it_is_fed(pattern, turned):
    pattern = replace(pattern, beam_azimuth_rad=2 * turned, beam_elevation_rad=-turned)

    # Turned, the edge of what lies behind crosses the steps of azimuth and elevation.
    assert mean_over_the_sphere(pattern) == pytest.approx(1, rel=1e-3 if turned else 1e-9)


@pytest.mark.parametrize("pattern", SMOOTH.values(), ids=SMOOTH)
def test_a_gain_that_is_given_scales_the_pattern(pattern):
    given = replace(pattern, gain=7.0)

    assert given.peak_gain == 7
    assert mean_over_the_sphere(given) == pytest.approx(7 / pattern.peak_gain, rel=1e-9)


@pytest.mark.parametrize("pattern", ALL.values(), ids=ALL)
def test_a_beam_that_is_turned_keeps_its_peak_and_nothing_exceeds_it(pattern):
    azimuth = np.linspace(-180, 180, 361) * DEG
    elevation = np.linspace(-90, 90, 361)[:, None] * DEG
    for at in [(0, 0), (40 * DEG, 20 * DEG), (-150 * DEG, -70 * DEG)]:
        turned = replace(pattern, beam_azimuth_rad=at[0], beam_elevation_rad=at[1])
        seen = turned.gain_towards(azimuth, elevation)
        assert seen.shape == (361, 361)
        assert turned.peak_gain == pattern.peak_gain
        assert 0.95 * pattern.peak_gain < seen.max() <= pattern.peak_gain * (1 + 1e-12)
        # What was ahead before it was turned.
        assert turned.gain_towards(*at) == pytest.approx(float(pattern.gain_towards(0, 0)))


def test_a_beam_that_looks_up_is_turned_and_not_sheared():
    up = replace(COSINE, beam_elevation_rad=60 * DEG)

    # From the zenith, 30 deg from the beam whatever the azimuth.
    assert up.gain_towards(2.0, 90 * DEG) == pytest.approx(
        float(COSINE.gain_towards(0, 30 * DEG)), rel=1e-9
    )
    # 60 deg of azimuth at an elevation of 60 deg are 29 deg of arc.
    ahead, left = (
        math.cos(60 * DEG) ** 2 * math.cos(60 * DEG) + math.sin(60 * DEG) ** 2,
        (math.cos(60 * DEG) * math.sin(60 * DEG)),
    )
    at = (math.atan2(left, ahead), math.asin(math.sin(60 * DEG) * math.cos(60 * DEG) / 2))
    assert up.gain_towards(60 * DEG, 60 * DEG) == pytest.approx(
        float(COSINE.gain_towards(*at)), rel=1e-9
    )


def test_a_cosine_beam_has_half_its_power_at_half_its_beamwidths_and_none_behind():
    half = COSINE.gain_towards([30 * DEG, -30 * DEG, 0, 0], [0, 0, 6 * DEG, -6 * DEG])

    assert half == pytest.approx(COSINE.peak_gain / 2, rel=1e-12)
    assert not COSINE.gain_towards([91 * DEG, 180 * DEG, 135 * DEG], [0, 0, 5 * DEG]).any()


def test_equal_beamwidths_make_a_round_beam():
    beam = replace(COSINE, elevation_beamwidth_rad=60 * DEG)
    power = math.log(0.5) / math.log(math.cos(30 * DEG))
    azimuth, elevation = 37 * DEG, -23 * DEG
    from_the_axis = math.cos(azimuth) * math.cos(elevation)

    # 2 (n + 1) is the directivity of cos^n before a plane.
    assert beam.peak_gain == pytest.approx(2 * (power + 1), rel=1e-12)
    assert beam.gain_towards(azimuth, elevation) == pytest.approx(
        2 * (power + 1) * from_the_axis**power, rel=1e-12
    )


def test_a_pencil_beam_has_the_gain_of_its_beamwidths():
    beam = replace(COSINE, azimuth_beamwidth_rad=1 * DEG, elevation_beamwidth_rad=0.5 * DEG)

    # A narrow Gaussian lobe: 16 ln 2 over the product of both widths.
    assert beam.peak_gain == pytest.approx(16 * math.log(2) / (0.5 * DEG**2), rel=1e-4)


def test_a_table_is_met_at_its_angles():
    seen = TABLE.gain_towards(TABLE.azimuth_rad, np.array(TABLE.elevation_rad)[:, None])

    assert seen == pytest.approx(np.array(TABLE.gain), rel=1e-12)
    assert TABLE.peak_gain == 20


def test_between_its_angles_a_table_is_bilinear_in_decibels():
    # A quarter of the way from 0 to 30 deg, half of that from 0 to 10 deg.
    levels = np.log([[20.0, 4.0], [6.0, 1.0]])
    expected = np.exp(np.array([0.5, 0.5]) @ levels @ np.array([0.75, 0.25]))

    assert TABLE.gain_towards(7.5 * DEG, 5 * DEG) == pytest.approx(expected, rel=1e-12)
    assert interpolate_angle_table([0, 1], [0], [[1, 0.01]], 0.5, 0) == pytest.approx(
        0.1, rel=1e-12
    )


def test_beyond_its_angles_a_table_holds_the_nearest_edge():
    seen = TABLE.gain_towards(
        np.array([80, 179, -179, -100, 0, 30]) * DEG, np.array([0, 0, 0, 0, 50, -80]) * DEG
    )

    assert seen == pytest.approx([0.05, 0.05, 0.02, 0.02, 6.0, 0.5], rel=1e-12)


@pytest.mark.parametrize("last_too", [True, False], ids=["closed", "a step short"])
@pytest.mark.parametrize("first", [-180, 0])
def test_a_table_of_a_whole_circle_wraps(first, last_too):
    at = np.arange(first, first + 360 + 45 * last_too, 45) * DEG
    gain = np.exp(np.cos(at - 0.3))
    whole = TablePattern(azimuth_rad=at, gain=[gain])

    # A cut at one elevation: the same at all of them.
    assert whole.gain_towards(at + 4 * math.pi, 40 * DEG) == pytest.approx(gain, rel=1e-9)
    seam = whole.gain_towards(at[0] - 22.5 * DEG, 0)
    before = gain[-2] if last_too else gain[-1]
    assert seam == pytest.approx(math.sqrt(before * gain[0]), rel=1e-9)


def test_a_table_of_another_shape_of_questions_answers_in_that_shape():
    ask = np.random.default_rng(7).uniform(-4, 4, (3, 1, 5))

    seen = interpolate_angle_table(
        TABLE.azimuth_rad, TABLE.elevation_rad, TABLE.gain, ask, np.zeros((2, 1))
    )

    assert seen.shape == (3, 2, 5)
    one = interpolate_angle_table(
        TABLE.azimuth_rad, TABLE.elevation_rad, TABLE.gain, ask[2, 0, 4], 0.0
    )
    assert seen[2, 1, 4] == pytest.approx(float(one), rel=1e-14)


def beamwidth_deg(pattern, azimuth):
    """Half-power width of a cut through the peak, along azimuth or along elevation."""
    angle = np.linspace(-90, 90, 180_001) * DEG
    cut = pattern.gain_towards(angle, 0) if azimuth else pattern.gain_towards(0, angle)
    above = angle[cut >= cut.max() / 2]
    return (above[-1] - above[0]) / DEG


def test_a_uniform_column_has_the_beam_of_a_uniform_array():
    aperture = 20 * 2 * COLUMN.patch_length_m / (SPEED_OF_LIGHT / 77e9)  # in wavelengths
    null = math.asin(1 / aperture)

    assert COLUMN.gain_towards(0, [null, -null]) == pytest.approx(0, abs=1e-12 * COLUMN.peak_gain)
    # 50.8 deg of an aperture of one wavelength; the patches take 1e-3 of it.
    assert beamwidth_deg(COLUMN, azimuth=False) == pytest.approx(50.8 / aperture, rel=5e-3)
    # The first sidelobe of a uniform array, 13.2 dB below the peak for many elements.
    lobes = COLUMN.gain_towards(0, np.linspace(null, 2 * null, 1001))
    assert 10 * np.log10(lobes.max() / COLUMN.peak_gain) == pytest.approx(-13.2, abs=0.2)


def test_a_patch_is_that_of_the_textbook():
    patch = PatchArray(
        n_patches=1,
        design_frequency_hz=10e9,
        relative_permittivity=2.2,
        substrate_thickness_m=1.588e-3,
    )

    # Balanis, example 14.1: W = 1.186 cm, effective permittivity 1.972, L = 0.906 cm with
    # 0.081 cm of fringing field at each end. To 1e-3: c is 3e8 m/s there.
    assert patch.patch_width_m == pytest.approx(1.186e-2, rel=1e-3)
    assert patch.effective_permittivity == pytest.approx(1.972, abs=5e-4)
    assert patch.patch_length_m == pytest.approx(0.906e-2 + 2 * 0.081e-2, rel=1e-3)
    # One patch on a large ground plane: 6 to 8 dB, wide in both planes.
    assert 6 < 10 * np.log10(patch.peak_gain) < 8
    assert 60 < beamwidth_deg(patch, azimuth=True) < 100
    assert 70 < beamwidth_deg(patch, azimuth=False) < 130


def test_more_patches_narrow_elevation_and_leave_azimuth():
    short = replace(COLUMN, n_patches=10)

    assert beamwidth_deg(short, azimuth=True) == pytest.approx(beamwidth_deg(COLUMN, azimuth=True))
    assert COLUMN.peak_gain / short.peak_gain == pytest.approx(2, rel=0.02)


def peak_elevation_deg(pattern):
    elevation = np.linspace(-40, 40, 80_001) * DEG
    return elevation[np.argmax(pattern.gain_towards(0, elevation))] / DEG


@pytest.mark.parametrize("tilt_deg", [-15.0, 0.0, 10.0])
def test_the_line_tilts_the_beam(tilt_deg):
    # The pattern of a patch pulls the peak of 20 of them by less than 0.15 deg.
    tilted = replace(COLUMN, tilt_rad=tilt_deg * DEG)
    assert peak_elevation_deg(tilted) == pytest.approx(tilt_deg, abs=0.15)


@pytest.mark.parametrize("frequency_hz", [76e9, 78e9])
def test_off_its_frequency_the_beam_squints(frequency_hz):
    fed = replace(COLUMN, n_patches=40, frequency_hz=frequency_hz)
    # One wavelength in the line: sin = sqrt(permittivity) (1 - f0 / f), 1.2 deg at 78 GHz.
    squint = math.asin(math.sqrt(fed.effective_permittivity) * (1 - 77e9 / frequency_hz))

    assert peak_elevation_deg(fed) == pytest.approx(squint / DEG, abs=0.02)


def test_a_taper_lowers_the_sidelobes():
    uniform = replace(TAPERED, taper=None)
    elevation = np.linspace(0, 60, 6001) * DEG

    def sidelobe(pattern):
        cut = pattern.gain_towards(0, elevation)
        after = np.argmax(np.diff(cut) > 0)
        return 10 * np.log10(cut[after:].max() / pattern.peak_gain)

    assert sidelobe(TAPERED) < sidelobe(uniform) - 4
    assert beamwidth_deg(TAPERED, azimuth=False) > beamwidth_deg(uniform, azimuth=False)


def test_loss_in_the_feed_lowers_the_gain_and_not_the_directivity():
    lossy = replace(COLUMN, efficiency=0.5)

    assert lossy.peak_gain == pytest.approx(COLUMN.peak_gain / 2)
    assert mean_over_the_sphere(lossy) == pytest.approx(0.5, rel=1e-9)


HARDWARE = Hardware(
    transmit_power_w=0.016, tx_pattern=COSINE, rx_pattern=COLUMN, noise_factor=16.0, loss=1.5
)


def test_the_radar_equation_takes_the_gains_towards_the_target(radar):
    radar = replace(radar, hardware=HARDWARE)
    azimuth, elevation, range_m = np.array([0, 12 * DEG]), np.array([0, -1.5 * DEG]), 40.0
    seen = {"range_m": range_m, "rcs_m2": 3.0, "azimuth_rad": azimuth, "elevation_rad": elevation}
    gains = COSINE.gain_towards(azimuth, elevation) * COLUMN.gain_towards(azimuth, elevation)
    wavelength_m = radar.frame.chirp.wavelength_m
    expected = 0.016 * gains * wavelength_m**2 * 3 / ((4 * np.pi) ** 3 * range_m**4 * 1.5)

    assert received_power_w(radar, **seen) == pytest.approx(expected, rel=1e-12)
    assert sample_snr(radar, **seen)[0] == pytest.approx(
        float(sample_snr(radar, range_m=40.0, rcs_m2=3.0))
    )
    # Between antennas of gain 1, the amplitude over both ways.
    bare = echo_amplitude(radar) ** 2 * 3 / range_m**4
    assert bare * gains == pytest.approx(expected, rel=1e-12)


def test_one_way_may_have_a_pattern_and_the_other_a_gain():
    mixed = replace(HARDWARE, rx_pattern=None, antenna_gain=5.0)

    assert mixed.rx_gain() == 5
    assert mixed.rx_gain([0, 1], [[0], [1], [2]]) == pytest.approx(np.full((3, 2), 5.0))
    assert mixed.tx_gain() == COSINE.peak_gain
    assert mixed.tx_gain(30 * DEG) == pytest.approx(COSINE.peak_gain / 2)
    assert mixed.tx_gain(None, 6 * DEG) == pytest.approx(COSINE.peak_gain / 2)
    assert mixed.eirp_w == pytest.approx(0.016 * COSINE.peak_gain)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tx_pattern": None}, r"Hardware.antenna_gain is none, and no tx_pattern"),
        ({"rx_pattern": None}, r"Hardware.antenna_gain is none, and no rx_pattern"),
        ({"rx_pattern": 10.0}, r"Hardware.rx_pattern is 10.0, .* cosine, patch-array, table"),
    ],
)
def test_antennas_of_unknown_gain_are_refused(change, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        replace(HARDWARE, **change)


def test_the_link_budget_says_how_far_off_the_beams_the_target_is(radar):
    target = dc.Target(position_m=(30 * math.cos(30 * DEG), 30 * math.sin(30 * DEG), 0))
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(targets=[target]))
    seeing = replace(radar, hardware=replace(HARDWARE, rx_pattern=None, antenna_gain=10.0))
    lines = {line.name: line.level_db for line in link_budget(scenario, seeing)}

    assert lines["off its transmit beam"] == pytest.approx(-3.0103, abs=1e-4)
    assert "off its receive beam" not in lines
    names = [*lines][: [*lines].index("echo in one receiver")]
    assert sum(lines[name] for name in names) == pytest.approx(lines["echo in one receiver"])
    behind = replace(seeing, hardware=replace(seeing.hardware, tx_pattern=replace(
        COSINE, beam_azimuth_rad=math.pi
    )))  # fmt: skip
    assert link_budget(scenario, behind) is None


@pytest.mark.parametrize("pattern", ALL.values(), ids=ALL)
def test_a_pattern_is_written_so_that_it_is_read_back_equal(pattern):
    turned = replace(pattern, beam_azimuth_rad=0.3, beam_elevation_rad=-0.1)
    hardware = replace(HARDWARE, tx_pattern=turned)

    assert parse_settings(dump(hardware), Hardware) == hardware


def test_a_settings_file_gives_gains_in_decibels_and_angles_in_degrees():
    text = (
        "transmit_power: 12 dBm\nnoise_factor: 12 dB\n"
        "tx_pattern: {kind: cosine, azimuth_beamwidth: 60 deg, elevation_beamwidth: 12 deg,"
        " gain: 13 dBi, beam_elevation: 2 deg}\n"
        "rx_pattern:\n  kind: table\n  azimuth: [-60 deg, 0, 60 deg]\n"
        "  gain: [[-10 dBi, 10 dBi, -10 dBi]]\n"
    )

    hardware = parse_settings(text, Hardware)

    assert hardware.tx_gain() == pytest.approx(10**1.3)
    assert hardware.rx_gain(30 * DEG, 0) == pytest.approx(1.0)
    with pytest.raises(dc.InvalidFile) as error:
        parse_settings(text.replace("60 deg]", "-60 deg]").replace("10 dBi, -10", "0"), Hardware)
    (only,) = error.value.mistakes
    assert (only.setting, only.line) == ("rx_pattern.azimuth.2", 6)
    assert only.value == "-60 deg after 0 deg"


WRONG_TABLES = [
    ({"azimuth_rad": [0, 2, 1, 3, 4]}, r"TablePattern.azimuth_rad.2 .* after 114.592 deg"),
    ({"azimuth_rad": [0, 1, 1, 3, 4]}, r"TablePattern.azimuth_rad.2 is 57.2958 deg after"),
    ({"azimuth_rad": [0, 1, math.nan, 3, 4]}, r"TablePattern.azimuth_rad.2 is nan"),
    ({"azimuth_rad": [-4, -2, 0, 2, 4]}, r"TablePattern.azimuth_rad.4 .* at most 360 deg past"),
    ({"azimuth_rad": []}, r"TablePattern.azimuth_rad .* a list of angles: at least one"),
    ({"azimuth_rad": 1.0}, r"TablePattern.azimuth_rad is 1.0, .* a list of angles"),
    ({"azimuth_rad": "12345"}, r"TablePattern.azimuth_rad is 12345, .* a list of angles"),
    ({"elevation_rad": [0, 1, 1.6]}, r"TablePattern.elevation_rad.2 is 1.6, .* at most 1.5708"),
    ({"elevation_rad": [0, 1]}, r"TablePattern.gain is 3 rows, .* 2 rows, one for each elevation"),
    ({"azimuth_rad": [0, 1, 2]}, r"TablePattern.gain.0 is 5 values, .* 3 values, one for each"),
    ({"gain": [[1] * 5, [1, 1], [1] * 5]}, r"TablePattern.gain.1 is 2 values, .* must be 5"),
    ({"gain": [[1] * 5, [1, 1, 1, math.nan, 1], [1] * 5]}, r"TablePattern.gain.1.3 is nan"),
    ({"gain": [[1] * 5, [1] * 5, [1, 0, 1, 1, 1]]}, r"TablePattern.gain.2.1 is 0.*at least 1e-12"),
    ({"gain": [[1] * 5, [1] * 5, [1, 1, -3, 1, 1]]}, r"TablePattern.gain.2.2 is -3"),
    ({"gain": [[1] * 5, [1] * 5, None]}, r"TablePattern.gain.2 is None, .* a list of values"),
    ({"gain": 3.0}, r"TablePattern.gain is 3.0, .* a list of rows: 3, one an elevation"),
    ({"beam_azimuth_rad": 4.0}, r"TablePattern.beam_azimuth_rad is 4.0"),
    ({"beam_elevation_rad": math.nan}, r"TablePattern.beam_elevation_rad is nan"),
]


@pytest.mark.parametrize(("change", "message"), WRONG_TABLES)
def test_a_table_that_cannot_be_read_names_the_first_wrong_place(change, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        replace(TABLE, **change)


def test_a_table_with_a_hole_says_where_it_is():
    azimuth = np.array([-40, -30, -20, 20, 30, 40]) * DEG
    with pytest.warns(dc.PhysicsWarning, match="azimuth_rad has a hole from -20 deg to 20 deg"):
        TablePattern(azimuth_rad=azimuth, gain=[np.ones(6)])
    elevation = np.array([-20, -10, 0, 80]) * DEG
    with pytest.warns(dc.PhysicsWarning, match="elevation_rad has a hole from 0 deg to 80 deg"):
        TablePattern(azimuth_rad=[0.0], elevation_rad=elevation, gain=np.ones((4, 1)))


WRONG = [
    (COSINE, {"azimuth_beamwidth_rad": 0.0}, "CosinePattern.azimuth_beamwidth_rad is 0.0"),
    (COSINE, {"azimuth_beamwidth_rad": 60.0}, "azimuth_beamwidth_rad is 60.0, .* to 3.1"),
    (COSINE, {"elevation_beamwidth_rad": math.nan}, "CosinePattern.elevation_beamwidth_rad is nan"),
    (COSINE, {"gain": -3.0}, "CosinePattern.gain is -3.0"),
    (COSINE, {"beam_elevation_rad": 2.0}, "CosinePattern.beam_elevation_rad is 2.0"),
    (COLUMN, {"n_patches": 0}, "PatchArray.n_patches is 0"),
    (COLUMN, {"design_frequency_hz": 77.0}, "PatchArray.design_frequency_hz is 77.0"),
    (COLUMN, {"frequency_hz": 24e9}, "PatchArray.frequency_hz is 24000000000.0"),
    (COLUMN, {"relative_permittivity": 0.5}, "PatchArray.relative_permittivity is 0.5"),
    (COLUMN, {"substrate_thickness_m": 1e-3}, "PatchArray.substrate_thickness_m is 0.001"),
    (COLUMN, {"spacing_m": 1e-3}, "PatchArray.spacing_m is 0.001"),
    (COLUMN, {"spacing_m": 5e-3}, "PatchArray.spacing_m is 0.005"),
    (COLUMN, {"taper": (1.0, 2.0)}, "PatchArray.taper is 2 powers, .* 20 powers"),
    (TAPERED, {"taper": (1, 1, 1, 0, 1, 1, 1, 1)}, r"PatchArray.taper.3 is 0"),
    (COLUMN, {"tilt_rad": 1.2}, "PatchArray.tilt_rad is 1.2"),
    (COLUMN, {"efficiency": 1.5}, "PatchArray.efficiency is 1.5"),
    (COLUMN, {"efficiency": 0.5, "gain": 10.0}, "PatchArray.efficiency is 0.5, beside a gain"),
    (COLUMN, {"gain": 0.0}, "PatchArray.gain is 0.0"),
]


@pytest.mark.parametrize(("pattern", "change", "message"), WRONG)
def test_an_antenna_that_cannot_be_is_refused_with_its_setting(pattern, change, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        replace(pattern, **change)
