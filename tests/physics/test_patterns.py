"""Antenna patterns: gain, beamwidth, tables and their effect on echo power."""

import math
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.config.loading import parse_settings
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.experiments.link_budget import link_budget_of_first_target
from dechirp.radar.angle_table import interpolate_angle_table
from dechirp.radar.budget import received_power_w, sample_snr, unit_echo_amplitude
from dechirp.radar.hardware import Hardware
from dechirp.radar.patterns.cosine import Cosine
from dechirp.radar.patterns.patch_array import PatchArray
from dechirp.radar.patterns.table import Table

DEG = math.pi / 180
COSINE_PATTERN = Cosine(azimuth_beamwidth_rad=60 * DEG, elevation_beamwidth_rad=12 * DEG)
TABLE_PATTERN = Table(
    azimuth_rad=[-60 * DEG, -20 * DEG, 0, 30 * DEG, 60 * DEG],
    elevation_rad=[-10 * DEG, 0, 10 * DEG],
    gain=[
        [0.01, 1.0, 3.0, 0.5, 0.02],
        [0.02, 5.0, 20.0, 4.0, 0.05],
        [0.01, 2.0, 6.0, 1.0, 0.03],
    ],
)
PATCH_COLUMN = PatchArray(n_patches=20, design_frequency_hz=77e9)
TILTED_COLUMN = replace(PATCH_COLUMN, n_patches=12, tilt_rad=10 * DEG)
TAPERED_COLUMN = replace(PATCH_COLUMN, n_patches=8, taper=(0.2, 0.5, 0.8, 1, 1, 0.8, 0.5, 0.2))
LOSSLESS_PATTERNS = {
    "cosine": COSINE_PATTERN,
    "column": PATCH_COLUMN,
    "tilted": TILTED_COLUMN,
    "tapered": TAPERED_COLUMN,
}
ALL_PATTERNS = {**LOSSLESS_PATTERNS, "table": TABLE_PATTERN}


def average_over_sphere(pattern, n=200):
    """Average the gain over all directions: Gauss in sine of elevation, equal azimuth steps."""
    sine_elevation, weight = np.polynomial.legendre.leggauss(n)
    azimuth = (np.arange(2 * n) + 0.5) * math.pi / n
    gain = pattern.gain_towards(azimuth, np.arcsin(sine_elevation)[:, None])
    return float(weight @ gain.mean(axis=1)) / 2


@pytest.mark.parametrize("beam_rad", [0.0, 25 * DEG])
@pytest.mark.parametrize("pattern", LOSSLESS_PATTERNS.values(), ids=LOSSLESS_PATTERNS)
def test_lossless_pattern_integrates_to_one_over_sphere(pattern, beam_rad):
    pattern = replace(pattern, beam_azimuth_rad=2 * beam_rad, beam_elevation_rad=-beam_rad)

    # A rotated beam has its rear edge across the azimuth and elevation steps: lower accuracy.
    assert average_over_sphere(pattern) == pytest.approx(1, rel=1e-3 if beam_rad else 1e-9)


@pytest.mark.parametrize("pattern", LOSSLESS_PATTERNS.values(), ids=LOSSLESS_PATTERNS)
def test_explicit_gain_scales_pattern(pattern):
    scaled_pattern = replace(pattern, gain=7.0)

    assert scaled_pattern.peak_gain == 7
    assert average_over_sphere(scaled_pattern) == pytest.approx(7 / pattern.peak_gain, rel=1e-9)


@pytest.mark.parametrize("pattern", ALL_PATTERNS.values(), ids=ALL_PATTERNS)
def test_rotated_beam_keeps_its_peak_gain(pattern):
    azimuth = np.linspace(-180, 180, 361) * DEG
    elevation = np.linspace(-90, 90, 361)[:, None] * DEG
    for beam in [(0, 0), (40 * DEG, 20 * DEG), (-150 * DEG, -70 * DEG)]:
        rotated_pattern = replace(pattern, beam_azimuth_rad=beam[0], beam_elevation_rad=beam[1])
        gains = rotated_pattern.gain_towards(azimuth, elevation)
        assert gains.shape == (361, 361)
        assert rotated_pattern.peak_gain == pattern.peak_gain
        assert 0.95 * pattern.peak_gain < gains.max() <= pattern.peak_gain * (1 + 1e-12)
        # The beam direction has the boresight gain of the unrotated pattern.
        assert rotated_pattern.gain_towards(*beam) == pytest.approx(
            float(pattern.gain_towards(0, 0))
        )


def test_raised_beam_is_rotated_and_not_sheared():
    raised_pattern = replace(COSINE_PATTERN, beam_elevation_rad=60 * DEG)

    # The zenith is 30 deg from the beam at any azimuth.
    assert raised_pattern.gain_towards(2.0, 90 * DEG) == pytest.approx(
        float(COSINE_PATTERN.gain_towards(0, 30 * DEG)), rel=1e-9
    )
    # At 60 deg elevation, 60 deg of azimuth are 29 deg of arc.
    x, y = (
        math.cos(60 * DEG) ** 2 * math.cos(60 * DEG) + math.sin(60 * DEG) ** 2,
        (math.cos(60 * DEG) * math.sin(60 * DEG)),
    )
    beam_angles = (math.atan2(y, x), math.asin(math.sin(60 * DEG) * math.cos(60 * DEG) / 2))
    assert raised_pattern.gain_towards(60 * DEG, 60 * DEG) == pytest.approx(
        float(COSINE_PATTERN.gain_towards(*beam_angles)), rel=1e-9
    )


def test_cosine_beam_has_half_power_at_beamwidth_and_none_behind():
    gains = COSINE_PATTERN.gain_towards([30 * DEG, -30 * DEG, 0, 0], [0, 0, 6 * DEG, -6 * DEG])

    assert gains == pytest.approx(COSINE_PATTERN.peak_gain / 2, rel=1e-12)
    assert not COSINE_PATTERN.gain_towards([91 * DEG, 180 * DEG, 135 * DEG], [0, 0, 5 * DEG]).any()


def test_equal_beamwidths_give_circular_beam():
    beam = replace(COSINE_PATTERN, elevation_beamwidth_rad=60 * DEG)
    power = math.log(0.5) / math.log(math.cos(30 * DEG))
    azimuth, elevation = 37 * DEG, -23 * DEG
    axis_cosine = math.cos(azimuth) * math.cos(elevation)

    # Directivity of cos^n over a half space: 2 (n + 1).
    assert beam.peak_gain == pytest.approx(2 * (power + 1), rel=1e-12)
    assert beam.gain_towards(azimuth, elevation) == pytest.approx(
        2 * (power + 1) * axis_cosine**power, rel=1e-12
    )


def test_pencil_beam_gain_follows_beamwidths():
    beam = replace(COSINE_PATTERN, azimuth_beamwidth_rad=1 * DEG, elevation_beamwidth_rad=0.5 * DEG)

    # Gain of a narrow Gaussian lobe: 16 ln 2 over the product of both widths.
    assert beam.peak_gain == pytest.approx(16 * math.log(2) / (0.5 * DEG**2), rel=1e-4)


def test_table_returns_its_own_gains():
    gains = TABLE_PATTERN.gain_towards(
        TABLE_PATTERN.azimuth_rad, np.array(TABLE_PATTERN.elevation_rad)[:, None]
    )

    assert gains == pytest.approx(np.array(TABLE_PATTERN.gain), rel=1e-12)
    assert TABLE_PATTERN.peak_gain == 20


def test_table_interpolates_bilinearly_in_decibels():
    # A quarter of the interval from 0 to 30 deg, half of the one from 0 to 10 deg.
    levels = np.log([[20.0, 4.0], [6.0, 1.0]])
    expected = np.exp(np.array([0.5, 0.5]) @ levels @ np.array([0.75, 0.25]))

    assert TABLE_PATTERN.gain_towards(7.5 * DEG, 5 * DEG) == pytest.approx(expected, rel=1e-12)
    assert interpolate_angle_table([0, 1], [0], [[1, 0.01]], 0.5, 0) == pytest.approx(
        0.1, rel=1e-12
    )


def test_table_extrapolates_with_nearest_edge():
    gains = TABLE_PATTERN.gain_towards(
        np.array([80, 179, -179, -100, 0, 30]) * DEG, np.array([0, 0, 0, 0, 50, -80]) * DEG
    )

    assert gains == pytest.approx([0.05, 0.05, 0.02, 0.02, 6.0, 0.5], rel=1e-12)


@pytest.mark.parametrize("is_closed", [True, False], ids=["closed", "open"])
@pytest.mark.parametrize("first_deg", [-180, 0])
def test_table_of_full_circle_wraps(first_deg, is_closed):
    angles = np.arange(first_deg, first_deg + 360 + 45 * is_closed, 45) * DEG
    gain = np.exp(np.cos(angles - 0.3))
    circle_pattern = Table(azimuth_rad=angles, gain=[gain])

    # A table of one elevation holds for all elevations.
    assert circle_pattern.gain_towards(angles + 4 * math.pi, 40 * DEG) == pytest.approx(
        gain, rel=1e-9
    )
    seam = circle_pattern.gain_towards(angles[0] - 22.5 * DEG, 0)
    previous_gain = gain[-2] if is_closed else gain[-1]
    assert seam == pytest.approx(math.sqrt(previous_gain * gain[0]), rel=1e-9)


def test_table_gains_have_shape_of_angles():
    azimuths = np.random.default_rng(7).uniform(-4, 4, (3, 1, 5))

    gains = interpolate_angle_table(
        TABLE_PATTERN.azimuth_rad,
        TABLE_PATTERN.elevation_rad,
        TABLE_PATTERN.gain,
        azimuths,
        np.zeros((2, 1)),
    )

    assert gains.shape == (3, 2, 5)
    single_gain = interpolate_angle_table(
        TABLE_PATTERN.azimuth_rad,
        TABLE_PATTERN.elevation_rad,
        TABLE_PATTERN.gain,
        azimuths[2, 0, 4],
        0.0,
    )
    assert gains[2, 1, 4] == pytest.approx(float(single_gain), rel=1e-14)


def measure_beamwidth_deg(pattern, azimuth):
    """Measure the half-power width of a cut through the peak along azimuth or elevation."""
    angle = np.linspace(-90, 90, 180_001) * DEG
    cut = pattern.gain_towards(angle, 0) if azimuth else pattern.gain_towards(0, angle)
    angles_above = angle[cut >= cut.max() / 2]
    return (angles_above[-1] - angles_above[0]) / DEG


def test_uniform_column_has_beam_of_uniform_array():
    aperture = 20 * 2 * PATCH_COLUMN.patch_length_m / (SPEED_OF_LIGHT / 77e9)  # in wavelengths
    null = math.asin(1 / aperture)

    assert PATCH_COLUMN.gain_towards(0, [null, -null]) == pytest.approx(
        0, abs=1e-12 * PATCH_COLUMN.peak_gain
    )
    # 50.8 deg over the aperture in wavelengths; the patch pattern narrows it by 1e-3.
    assert measure_beamwidth_deg(PATCH_COLUMN, azimuth=False) == pytest.approx(
        50.8 / aperture, rel=5e-3
    )
    # First sidelobe of a uniform array of many elements: 13.2 dB below the peak.
    lobes = PATCH_COLUMN.gain_towards(0, np.linspace(null, 2 * null, 1001))
    assert 10 * np.log10(lobes.max() / PATCH_COLUMN.peak_gain) == pytest.approx(-13.2, abs=0.2)


def test_patch_dimensions_match_balanis_example():
    patch = PatchArray(
        n_patches=1,
        design_frequency_hz=10e9,
        relative_permittivity=2.2,
        substrate_thickness_m=1.588e-3,
    )

    # Balanis, example 14.1: W = 1.186 cm, effective permittivity 1.972, L = 0.906 cm with
    # 0.081 cm of fringing field at each end. Tolerance 1e-3: Balanis uses c = 3e8 m/s.
    assert patch.patch_width_m == pytest.approx(1.186e-2, rel=1e-3)
    assert patch.effective_permittivity == pytest.approx(1.972, abs=5e-4)
    assert patch.patch_length_m == pytest.approx(0.906e-2 + 2 * 0.081e-2, rel=1e-3)
    # One patch on a large ground plane: 6 to 8 dB, wide in both planes.
    assert 6 < 10 * np.log10(patch.peak_gain) < 8
    assert 60 < measure_beamwidth_deg(patch, azimuth=True) < 100
    assert 70 < measure_beamwidth_deg(patch, azimuth=False) < 130


def test_more_patches_narrow_elevation_only():
    short_column = replace(PATCH_COLUMN, n_patches=10)

    assert measure_beamwidth_deg(short_column, azimuth=True) == pytest.approx(
        measure_beamwidth_deg(PATCH_COLUMN, azimuth=True)
    )
    assert PATCH_COLUMN.peak_gain / short_column.peak_gain == pytest.approx(2, rel=0.02)


def find_peak_elevation_deg(pattern):
    elevation = np.linspace(-40, 40, 80_001) * DEG
    return elevation[np.argmax(pattern.gain_towards(0, elevation))] / DEG


@pytest.mark.parametrize("tilt_deg", [-15.0, 0.0, 10.0])
def test_feed_line_tilts_beam(tilt_deg):
    # The element pattern shifts the peak of 20 patches by less than 0.15 deg.
    tilted_column = replace(PATCH_COLUMN, tilt_rad=tilt_deg * DEG)
    assert find_peak_elevation_deg(tilted_column) == pytest.approx(tilt_deg, abs=0.15)


@pytest.mark.parametrize("frequency_hz", [76e9, 78e9])
def test_beam_squints_off_design_frequency(frequency_hz):
    detuned_column = replace(PATCH_COLUMN, n_patches=40, frequency_hz=frequency_hz)
    # One wavelength of line per patch: sin = sqrt(permittivity) (1 - f0 / f), 1.2 deg at 78 GHz.
    squint = math.asin(math.sqrt(detuned_column.effective_permittivity) * (1 - 77e9 / frequency_hz))

    assert find_peak_elevation_deg(detuned_column) == pytest.approx(squint / DEG, abs=0.02)


def test_taper_lowers_sidelobes():
    uniform_column = replace(TAPERED_COLUMN, taper=None)
    elevation = np.linspace(0, 60, 6001) * DEG

    def measure_sidelobe_db(pattern):
        cut = pattern.gain_towards(0, elevation)
        null_index = np.argmax(np.diff(cut) > 0)
        return 10 * np.log10(cut[null_index:].max() / pattern.peak_gain)

    assert measure_sidelobe_db(TAPERED_COLUMN) < measure_sidelobe_db(uniform_column) - 4
    assert measure_beamwidth_deg(TAPERED_COLUMN, azimuth=False) > measure_beamwidth_deg(
        uniform_column, azimuth=False
    )


def test_feed_loss_lowers_gain_and_not_directivity():
    lossy_column = replace(PATCH_COLUMN, efficiency=0.5)

    assert lossy_column.peak_gain == pytest.approx(PATCH_COLUMN.peak_gain / 2)
    assert average_over_sphere(lossy_column) == pytest.approx(0.5, rel=1e-9)


HARDWARE = Hardware(
    transmit_power_w=0.016,
    tx_pattern=COSINE_PATTERN,
    rx_pattern=PATCH_COLUMN,
    noise_factor=16.0,
    loss=1.5,
)


def test_radar_equation_uses_gains_towards_target(radar):
    radar = replace(radar, hardware=HARDWARE)
    azimuth, elevation, range_m = np.array([0, 12 * DEG]), np.array([0, -1.5 * DEG]), 40.0
    target_settings = {
        "range_m": range_m,
        "rcs_m2": 3.0,
        "azimuth_rad": azimuth,
        "elevation_rad": elevation,
    }
    gains = COSINE_PATTERN.gain_towards(azimuth, elevation) * PATCH_COLUMN.gain_towards(
        azimuth, elevation
    )
    wavelength_m = radar.frame.chirp.wavelength_m
    expected = 0.016 * gains * wavelength_m**2 * 3 / ((4 * np.pi) ** 3 * range_m**4 * 1.5)

    assert received_power_w(radar, **target_settings) == pytest.approx(expected, rel=1e-12)
    assert sample_snr(radar, **target_settings)[0] == pytest.approx(
        float(sample_snr(radar, range_m=40.0, rcs_m2=3.0))
    )
    # Two-way amplitude between antennas of gain 1.
    isotropic_power_w = unit_echo_amplitude(radar) ** 2 * 3 / range_m**4
    assert isotropic_power_w * gains == pytest.approx(expected, rel=1e-12)


def test_hardware_mixes_pattern_and_gain():
    mixed_hardware = replace(HARDWARE, rx_pattern=None, antenna_gain=5.0)

    assert mixed_hardware.rx_gain() == 5
    assert mixed_hardware.rx_gain([0, 1], [[0], [1], [2]]) == pytest.approx(np.full((3, 2), 5.0))
    assert mixed_hardware.tx_gain() == COSINE_PATTERN.peak_gain
    assert mixed_hardware.tx_gain(30 * DEG) == pytest.approx(COSINE_PATTERN.peak_gain / 2)
    assert mixed_hardware.tx_gain(None, 6 * DEG) == pytest.approx(COSINE_PATTERN.peak_gain / 2)
    assert mixed_hardware.eirp_w == pytest.approx(0.016 * COSINE_PATTERN.peak_gain)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"tx_pattern": None}, r"Hardware.antenna_gain: missing, and tx_pattern"),
        ({"rx_pattern": None}, r"Hardware.antenna_gain: missing, and rx_pattern"),
        ({"rx_pattern": 10.0}, r"Hardware.rx_pattern: 10.0.*cosine, patch-array, table"),
    ],
)
def test_rejects_antennas_of_unknown_gain(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        replace(HARDWARE, **settings)


def test_link_budget_lists_off_beam_losses(radar):
    target = dc.Target(position_m=(30 * math.cos(30 * DEG), 30 * math.sin(30 * DEG), 0))
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(targets=[target]))
    budget_radar = replace(radar, hardware=replace(HARDWARE, rx_pattern=None, antenna_gain=10.0))
    lines = {
        line.name: line.level_db for line in link_budget_of_first_target(scenario, budget_radar)
    }

    assert lines["off its transmit beam"] == pytest.approx(-3.0103, abs=1e-4)
    assert "off its receive beam" not in lines
    names = [*lines][: [*lines].index("echo in one receiver")]
    assert sum(lines[name] for name in names) == pytest.approx(lines["echo in one receiver"])
    rear_pattern = replace(COSINE_PATTERN, beam_azimuth_rad=math.pi)
    backward_radar = replace(
        budget_radar, hardware=replace(budget_radar.hardware, tx_pattern=rear_pattern)
    )
    assert link_budget_of_first_target(scenario, backward_radar) is None


@pytest.mark.parametrize("pattern", ALL_PATTERNS.values(), ids=ALL_PATTERNS)
def test_pattern_settings_round_trip(pattern):
    rotated_pattern = replace(pattern, beam_azimuth_rad=0.3, beam_elevation_rad=-0.1)
    hardware = replace(HARDWARE, tx_pattern=rotated_pattern)

    assert parse_settings(dump_yaml(hardware), Hardware) == hardware


def test_settings_accept_gains_in_decibels_and_angles_in_degrees():
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
    (mistake,) = error.value.mistakes
    assert (mistake.setting, mistake.line) == ("rx_pattern.azimuth.2", 6)
    assert mistake.value == "-60 deg after 0 deg"


INVALID_TABLES = [
    ({"azimuth_rad": [0, 2, 1, 3, 4]}, r"Table.azimuth_rad.2.* after 114.592 deg"),
    ({"azimuth_rad": [0, 1, 1, 3, 4]}, r"Table.azimuth_rad.2: 57.2958 deg after"),
    ({"azimuth_rad": [0, 1, math.nan, 3, 4]}, r"Table.azimuth_rad.2: nan"),
    ({"azimuth_rad": [-4, -2, 0, 2, 4]}, r"Table.azimuth_rad.4.* at most 360 deg past"),
    ({"azimuth_rad": []}, r"Table.azimuth_rad.* a list of angles: at least one"),
    ({"azimuth_rad": 1.0}, r"Table.azimuth_rad: 1.0.*a list of angles"),
    ({"azimuth_rad": "12345"}, r"Table.azimuth_rad: 12345.*a list of angles"),
    ({"elevation_rad": [0, 1, 1.6]}, r"Table.elevation_rad.2: 1.6.*at most 1.5708"),
    ({"elevation_rad": [0, 1]}, r"Table.gain: 3 rows.*2 rows, one for each elevation"),
    ({"azimuth_rad": [0, 1, 2]}, r"Table.gain.0: 5 values.*3 values, one for each"),
    ({"gain": [[1] * 5, [1, 1], [1] * 5]}, r"Table.gain.1: 2 values.*expected 5"),
    ({"gain": [[1] * 5, [1, 1, 1, math.nan, 1], [1] * 5]}, r"Table.gain.1.3: nan"),
    ({"gain": [[1] * 5, [1] * 5, [1, 0, 1, 1, 1]]}, r"Table.gain.2.1: 0.*at least 1e-12"),
    ({"gain": [[1] * 5, [1] * 5, [1, 1, -3, 1, 1]]}, r"Table.gain.2.2: -3"),
    ({"gain": [[1] * 5, [1] * 5, None]}, r"Table.gain.2: None.*a list of values"),
    ({"gain": 3.0}, r"Table.gain: 3.0.*a list of rows: 3, one an elevation"),
    ({"beam_azimuth_rad": 4.0}, r"Table.beam_azimuth_rad: 4.0"),
    ({"beam_elevation_rad": math.nan}, r"Table.beam_elevation_rad: nan"),
]


@pytest.mark.parametrize(("settings", "message"), INVALID_TABLES)
def test_rejects_invalid_table_at_first_wrong_entry(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        replace(TABLE_PATTERN, **settings)


def test_warns_of_gap_in_table_angles():
    azimuth = np.array([-40, -30, -20, 20, 30, 40]) * DEG
    with pytest.warns(dc.PhysicsWarning, match="azimuth_rad.*gap from -20 deg to 20 deg"):
        Table(azimuth_rad=azimuth, gain=[np.ones(6)])
    elevation = np.array([-20, -10, 0, 80]) * DEG
    with pytest.warns(dc.PhysicsWarning, match="elevation_rad.*gap from 0 deg to 80 deg"):
        Table(azimuth_rad=[0.0], elevation_rad=elevation, gain=np.ones((4, 1)))


INVALID_ANTENNAS = [
    (COSINE_PATTERN, {"azimuth_beamwidth_rad": 0.0}, "Cosine.azimuth_beamwidth_rad: 0.0"),
    (COSINE_PATTERN, {"azimuth_beamwidth_rad": 60.0}, "azimuth_beamwidth_rad: 60.0.*to 3.1"),
    (
        COSINE_PATTERN,
        {"elevation_beamwidth_rad": math.nan},
        "Cosine.elevation_beamwidth_rad: nan",
    ),
    (COSINE_PATTERN, {"gain": -3.0}, "Cosine.gain: -3.0"),
    (COSINE_PATTERN, {"beam_elevation_rad": 2.0}, "Cosine.beam_elevation_rad: 2.0"),
    (PATCH_COLUMN, {"n_patches": 0}, "PatchArray.n_patches: 0"),
    (PATCH_COLUMN, {"design_frequency_hz": 77.0}, "PatchArray.design_frequency_hz: 77.0"),
    (PATCH_COLUMN, {"frequency_hz": 24e9}, "PatchArray.frequency_hz: 24000000000.0"),
    (PATCH_COLUMN, {"relative_permittivity": 0.5}, "PatchArray.relative_permittivity: 0.5"),
    (PATCH_COLUMN, {"substrate_thickness_m": 1e-3}, "PatchArray.substrate_thickness_m: 0.001"),
    (PATCH_COLUMN, {"spacing_m": 1e-3}, "PatchArray.spacing_m: 0.001"),
    (PATCH_COLUMN, {"spacing_m": 5e-3}, "PatchArray.spacing_m: 0.005"),
    (PATCH_COLUMN, {"taper": (1.0, 2.0)}, "PatchArray.taper: 2 powers.*20 powers"),
    (TAPERED_COLUMN, {"taper": (1, 1, 1, 0, 1, 1, 1, 1)}, r"PatchArray.taper.3: 0"),
    (PATCH_COLUMN, {"tilt_rad": 1.2}, "PatchArray.tilt_rad: 1.2"),
    (PATCH_COLUMN, {"efficiency": 1.5}, "PatchArray.efficiency: 1.5"),
    (
        PATCH_COLUMN,
        {"efficiency": 0.5, "gain": 10.0},
        "PatchArray.efficiency: 0.5, together with a gain",
    ),
    (PATCH_COLUMN, {"gain": 0.0}, "PatchArray.gain: 0.0"),
]


@pytest.mark.parametrize(("pattern", "settings", "message"), INVALID_ANTENNAS)
def test_rejects_invalid_antenna_setting(pattern, settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        replace(pattern, **settings)
