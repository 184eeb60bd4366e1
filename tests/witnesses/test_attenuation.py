"""Attenuation by gas, rain, fog and water films, and Mie scattering, against published values."""

import json
import math
from pathlib import Path

import mpmath
import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.theory.attenuation import (
    fog_db_per_km,
    gas_db_per_km,
    oxygen_db_per_km,
    rain_db_per_km,
    rain_power_law,
    vapour_db_per_km,
)
from dechirp.theory.mie import sphere_rcs_m2
from dechirp.theory.rain_backscatter import (
    DIAMETERS_M,
    drop_fall_speed_m_per_s,
    drop_size_density_per_m4,
    rain_reflectivity_per_m,
)
from dechirp.theory.water_permittivity import water_film_loss, water_relative_permittivity
from nightly import nightly_except

MM_PER_H = 1e-3 / 3600

# Validation values of the ITU study group for P.676-12 and 13: 1013.25 hPa, 288.15 K, 7.5 g/m^3;
# oxygen, then water vapour, dB/km.
GASES = {
    1: (0.00538865816790655, 5.09046173249644e-05),
    59: (13.6352956340441, 0.149984058069274),
    60: (14.6234747964861, 0.154841840636247),
    77: (0.0975258356252428, 0.25051767864174),
    100: (0.033625442078135, 0.424433522672505),
    119: (1.30637904078462, 0.617993479946656),
    179: (0.0125954102681107, 10.343578309943),
    299: (0.0256008930626654, 5.14158938794715),
}


@pytest.mark.parametrize("gigahertz", GASES)
def test_oxygen_and_water_vapour_match_itu_values(gigahertz):
    oxygen, vapour = GASES[gigahertz]
    assert oxygen_db_per_km(gigahertz * 1e9) == pytest.approx(oxygen, rel=1e-9)
    assert vapour_db_per_km(gigahertz * 1e9) == pytest.approx(vapour, rel=1e-9)


def test_clear_air_attenuates_a_third_of_a_db_per_km_at_77_ghz():
    assert oxygen_db_per_km(77e9) == pytest.approx(0.098, abs=5e-4)
    assert vapour_db_per_km(77e9) == pytest.approx(0.251, abs=5e-4)
    assert gas_db_per_km(77e9) == pytest.approx(0.348, abs=5e-4)


def test_dry_air_attenuates_by_oxygen_alone():
    dry = gas_db_per_km(77e9, vapour_kg_per_m3=0.0)
    assert dry == oxygen_db_per_km(77e9, vapour_kg_per_m3=0.0)


# Table 5 of P.838-3, three or four digits: k_H, alpha_H, k_V, alpha_V.
RAIN = {
    1: (2.59e-5, 0.9691, 3.08e-5, 0.8592),
    10: (0.01217, 1.2571, 0.01129, 1.2156),
    30: (0.2403, 0.9485, 0.2291, 0.9129),
    77: (1.1320, 0.7177, 1.1276, 0.7073),
    80: (1.1704, 0.7115, 1.1668, 0.7021),
    100: (1.3671, 0.6815, 1.3680, 0.6765),
}


@pytest.mark.parametrize("gigahertz", RAIN)
def test_rain_power_law_matches_table_coefficients(gigahertz):
    coefficients = np.ravel(rain_power_law(gigahertz * 1e9))
    assert coefficients == pytest.approx(RAIN[gigahertz], rel=5e-4)


def test_rain_attenuation_matches_table_at_77_ghz():
    heavy = 25 * MM_PER_H
    assert rain_db_per_km(77e9, heavy) == pytest.approx(11.4, abs=0.05)
    assert rain_db_per_km(77e9, heavy, tilt_rad=math.pi / 2) == pytest.approx(11.0, abs=0.05)
    assert rain_db_per_km(77e9, 4 * MM_PER_H) == pytest.approx(3.06, abs=5e-3)
    slanted = rain_db_per_km(77e9, heavy, tilt_rad=math.pi / 4)
    assert 11.0 < slanted < 11.4
    assert rain_db_per_km(77e9, 0.0) == 0


def test_rain_attenuation_matches_public_case():
    cases = json.loads((Path(__file__).parent / "theory_public.json").read_text())["cases"]
    case = next(case for case in cases if case["id"] == "rain_77_10_H")
    attenuation = rain_db_per_km(
        case["inputs"]["freq_ghz"] * 1e9, case["inputs"]["rain_rate_mmph"] * MM_PER_H
    )
    assert attenuation == pytest.approx(case["expected"], rel=case["tol_rel"])


def test_fog_attenuation_falls_with_temperature():
    attenuations = [fog_db_per_km(77e9, 1e-3, temperature_k=273.15 + t) for t in (0, 10, 20)]
    assert attenuations == pytest.approx([3.54, 3.15, 2.71], abs=5e-3)
    assert fog_db_per_km(77e9, 5e-4, temperature_k=283.15) == pytest.approx(1.57, abs=5e-3)


def test_water_has_static_permittivity_at_low_frequencies():
    # Static permittivity at 20 degrees: 80.1 (CRC Handbook).
    assert water_relative_permittivity(1e6, 293.15).real == pytest.approx(80.1, rel=2e-3)


def test_small_metal_sphere_follows_rayleigh_and_large_one_its_shadow():
    x = np.array([0.01, 0.03])
    radius_m = x / (2 * np.pi)
    # Rayleigh cross section (9 x^4) pi r^2; the next order is x^2.
    assert sphere_rcs_m2(radius_m, 1.0) == pytest.approx(9 * x**4 * np.pi * radius_m**2, rel=2e-3)
    assert float(sphere_rcs_m2(60.0, 1.0)) == pytest.approx(np.pi * 60**2, rel=2e-3)


def test_metal_sphere_resonates_at_circumference_of_one_wavelength():
    x = np.linspace(0.5, 2.0, 1501)
    radius_m = x / (2 * np.pi)
    efficiency = sphere_rcs_m2(radius_m, 1.0) / (np.pi * radius_m**2)
    # The first maximum of the textbook curve (Skolnik 2001, 2.7): 3.65 near 1.03.
    assert efficiency.max() == pytest.approx(3.65, abs=0.02)
    assert x[efficiency.argmax()] == pytest.approx(1.03, abs=0.01)


def compute_mie_in_30_digits(x, permittivity=None):
    """Compute the cross section over pi r^2 from Bessel functions and their derivatives."""
    with mpmath.workdps(30):
        x = mpmath.mpf(x)

        def psi(n, z):
            return mpmath.sqrt(mpmath.pi * z / 2) * mpmath.besselj(n + 0.5, z)

        def xi(n, z):
            return mpmath.sqrt(mpmath.pi * z / 2) * mpmath.hankel1(n + 0.5, z)

        def slope(f, n, z):
            return f(n - 1, z) - n / z * f(n, z)

        total = mpmath.mpc(0)
        for n in range(1, int(x) + 25):
            outer = [psi(n, x), slope(psi, n, x), xi(n, x), slope(xi, n, x)]
            if permittivity is None:
                a, b = outer[1] / outer[3], outer[0] / outer[2]
            else:
                m = mpmath.sqrt(mpmath.mpc(permittivity))
                inner, inner_slope = psi(n, m * x), slope(psi, n, m * x)
                a = (m * inner * outer[1] - outer[0] * inner_slope) / (
                    m * inner * outer[3] - outer[2] * inner_slope
                )
                b = (inner * outer[1] - m * outer[0] * inner_slope) / (
                    inner * outer[3] - m * outer[2] * inner_slope
                )
            total += (-1) ** n * (2 * n + 1) * (a - b)
        return float(abs(total) ** 2 / x**2)


@pytest.mark.parametrize("x", nightly_except((0.05, 7.0), [0.05, 0.8, 2.4, 7.0, 20.0]))
@pytest.mark.parametrize("epsilon", nightly_except(3, [None, 7.62 + 12.8j, 2.5 + 0.01j, 80 + 4j]))
def test_mie_series_matches_thirty_digits(x, epsilon):
    radius_m = x / (2 * np.pi)
    efficiency = sphere_rcs_m2([radius_m, 1e-4], 1.0, permittivity=epsilon) / (np.pi * radius_m**2)
    assert efficiency[0] == pytest.approx(compute_mie_in_30_digits(x, epsilon), rel=1e-9)


def test_rain_reflects_as_rayleigh_scatterers_at_3_ghz():
    # N0 6! / Lambda^7 for Marshall and Palmer's drop sizes, all far smaller than the wavelength;
    # drops above 7 mm, which break up, contribute 1 % in light rain.
    epsilon = water_relative_permittivity(3e9, 283.15)
    size = abs((epsilon - 1) / (epsilon + 2)) ** 2
    z_m3 = 8e6 * math.factorial(6) / 4100.0**7
    wavelength_m = SPEED_OF_LIGHT / 3e9
    expected = math.pi**5 / wavelength_m**4 * size * z_m3
    assert rain_reflectivity_per_m(3e9, MM_PER_H) == pytest.approx(expected, rel=0.03)


def test_drop_sizes_and_speeds_give_rain_rate():
    # Volume of all drops times their fall speed. Marshall and Palmer's fit does not conserve it:
    # up to 20 % more in light rain.
    for rate in (2, 10, 25):
        volumes_m3 = np.pi / 6 * DIAMETERS_M**3
        flux = drop_size_density_per_m4(DIAMETERS_M, rate * MM_PER_H) * volumes_m3
        flux = flux * drop_fall_speed_m_per_s(DIAMETERS_M)
        rain_rate = flux.sum() * (DIAMETERS_M[1] - DIAMETERS_M[0]) / MM_PER_H
        assert rain_rate == pytest.approx(rate, rel=0.2)


def test_drop_fall_speeds_match_gunn_and_kinzer():
    measured = {1e-3: 4.03, 2e-3: 6.49, 3e-3: 8.06, 5e-3: 9.09}
    for diameter_m, speed in measured.items():
        assert float(drop_fall_speed_m_per_s(diameter_m)) == pytest.approx(speed, rel=0.02)


def test_thick_water_film_attenuates_by_reflection_and_absorption():
    assert water_film_loss(77e9, 0.0, 283.15) == 1
    # A thick film has two surfaces and absorption between them, without internal reflections.
    n = np.sqrt(water_relative_permittivity(77e9, 283.15))
    surfaces = abs(4 * n / (1 + n) ** 2) ** 2
    absorption = math.exp(4 * math.pi * n.imag * 77e9 * 3e-3 / SPEED_OF_LIGHT)
    assert water_film_loss(77e9, 3e-3, 283.15) == pytest.approx(absorption / surfaces, rel=1e-6)


def test_thin_water_film_matches_plane_wave_solution():
    # Continuity of the fields at both faces gives four equations.
    n = np.sqrt(water_relative_permittivity(77e9, 283.15))
    k, d = 2 * np.pi * 77e9 / SPEED_OF_LIGHT, 0.1e-3
    forward, backward = np.exp(1j * k * n * d), np.exp(-1j * k * n * d)
    fields = np.array(
        [
            [1, -1, -1, 0],
            [-1, -n, n, 0],
            [0, forward, backward, -1],
            [0, n * forward, -n * backward, -1],
        ]
    )
    *_, transmitted = np.linalg.solve(fields, np.array([-1, -1, 0, 0]))
    assert water_film_loss(77e9, d, 283.15) == pytest.approx(1 / abs(transmitted) ** 2, rel=1e-9)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: gas_db_per_km(0.5e9), "frequency_hz"),
        (lambda: gas_db_per_km(77e9, temperature_k=15.0), "temperature_k"),
        (lambda: gas_db_per_km(77e9, pressure_pa=-1.0), "pressure_pa"),
        (lambda: gas_db_per_km(77e9, vapour_kg_per_m3=7.5), "vapour_kg_per_m3"),
        (lambda: rain_db_per_km(77e9, 25.0), "rate_m_per_s"),
        (lambda: rain_db_per_km(77e9, -1e-6), "rate_m_per_s"),
        (lambda: rain_power_law(2e12), "frequency_hz"),
        (lambda: fog_db_per_km(300e9, 5e-4), "frequency_hz"),
        (lambda: fog_db_per_km(77e9, 0.5), "water_kg_per_m3"),
        (lambda: water_relative_permittivity(77e9, 400.0), "temperature_k"),
        (lambda: water_film_loss(77e9, -1e-4, 283.15), "film_m"),
        (lambda: sphere_rcs_m2(1.0, 1e-3), "radius_m"),
        (lambda: sphere_rcs_m2(1.0, 1.0, permittivity=4 - 1j), "permittivity"),
        (lambda: drop_size_density_per_m4(1e-3, 1.0), "rate_m_per_s"),
    ],
)
def test_rejects_arguments_outside_formula_ranges(call, name):
    with pytest.raises(dc.InvalidSetting, match=name):
        call()
