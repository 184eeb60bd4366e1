"""Half-power beamwidth of an array, and where it is shown."""

import math
from dataclasses import replace

import pytest

import dechirp as dc
from dechirp.radar.design.derived import derive_radar_values
from dechirp.radar.design.requirements import Requirements

WAVELENGTH_M = 3.9e-3


def test_two_elements_half_a_wavelength_apart_halve_power_at_30_degrees():
    # cos(pi d sin(theta) / lambda)^2 = 1/2 at sin(theta) = lambda / 4 d.
    array = dc.Array(rx_m=[(0, 0, 0), (0, WAVELENGTH_M / 2, 0)])
    assert array.azimuth_beamwidth_rad(WAVELENGTH_M) == pytest.approx(math.radians(60), rel=1e-3)


def test_long_array_has_textbook_beamwidth():
    # 0.886 lambda / N d (Van Trees 2002, 2.4), also with transmitters that extend the receivers.
    spacing_m = WAVELENGTH_M / 2
    array = dc.Array(
        tx_m=[(0, 0, 0), (0, 32 * spacing_m, 0)], rx_m=[(0, k * spacing_m, 0) for k in range(32)]
    )
    assert array.azimuth_beamwidth_rad(WAVELENGTH_M) == pytest.approx(0.886 / 32, rel=2e-3)


def test_single_element_has_no_beamwidth():
    assert math.isnan(dc.Array().azimuth_beamwidth_rad(WAVELENGTH_M))


def test_design_and_radar_show_beamwidth_of_array():
    radar = dc.design(max_range_m=150, range_resolution_m=1, max_velocity_m_per_s=20).radar
    radar = replace(radar, array=dc.Array(rx_m=[(0, k * 1.95e-3, 0) for k in range(8)]))
    requirements = Requirements(max_range_m=150, range_resolution_m=1, max_velocity_m_per_s=20)

    derived = derive_radar_values(radar, requirements, speed_of_light_m_per_s=299_792_458.0)

    values = {value.name: value.value_with_unit for value in derived}
    assert values["azimuth_beamwidth"] == "12.8°"
    *_, table = radar._display_tables()
    assert ("azimuth beamwidth", "12.8°") in [row[:2] for row in table.rows]
