"""Wall, pole and foliage, against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad

import dechirp as dc
from dechirp.radar.budget import received_power_w
from dechirp.scene.bodies.foliage import Foliage
from dechirp.scene.bodies.guard_rail import GuardRail
from dechirp.scene.bodies.pole import Pole
from dechirp.scene.bodies.wall import CONCRETE_REFLECTIVITY, Wall
from nightly import nightly_except

WAVELENGTH_M = 299_792_458 / 77e9


def cross_sections_m2(body, radar_m):
    return body.cross_sections_towards_m2(np.array([radar_m]), WAVELENGTH_M)[0]


@pytest.mark.parametrize("x_m", [-7.3, 0.0, 4.1])
def test_smooth_metal_wall_is_a_mirror(x_m):
    # The echo of a mirror at the distance d is that of the image of the radar (Friis). The ends of
    # the wall change it by 0.3 %.
    wall = Wall(length_m=40.0, width_m=0.4, height_m=3.0, reflectivity=1.0, scattering=0.0)
    radar, distance_m = dc.reference().radar, 9.8

    rcs_m2 = cross_sections_m2(wall, (x_m, distance_m + 0.2, 0.5))

    assert rcs_m2.sum() == pytest.approx(math.pi * distance_m**2, rel=0.02)
    # Friis over 2 d, with power, gains and losses from an echo of 1 m^2 at 1 m.
    budget_w = received_power_w(radar, range_m=1.0, rcs_m2=1.0) * 4 * math.pi
    assert received_power_w(radar, range_m=distance_m, rcs_m2=rcs_m2.sum()) == pytest.approx(
        budget_w / (2 * distance_m) ** 2, rel=0.02
    )
    offsets_m = wall.scatterer_offsets_m(np.zeros(1))[0]
    assert rcs_m2 @ offsets_m / rcs_m2.sum() == pytest.approx((x_m, 0.2, 0.5), abs=0.26)


@pytest.mark.parametrize("radar_m", [(30.0, 5.0, 0.5), (12.0, 1.0, 4.5), (0.0, 10.0, 0.5)])
def test_mirror_of_a_wall_requires_its_foot_on_the_face(radar_m):
    wall = Wall(length_m=40.0, width_m=0.4, height_m=3.0, reflectivity=1.0, scattering=0.0)
    has_foot = abs(radar_m[0]) < 20 and radar_m[2] < 3

    assert (cross_sections_m2(wall, radar_m).sum() > 0) == has_foot


def test_diffuse_cross_section_of_a_wall_is_that_of_lambert():
    # Integral of 4 R S^2 cos^2 over the face towards the radar; cells of 1 x 3 m at 12 m.
    wall = Wall(length_m=8.0, width_m=0.4, height_m=3.0, scattering=1.0)
    radar_m = (3.0, 12.2, 0.5)

    def density(z_m, x_m):
        cosine2 = 12.0**2 / (12.0**2 + (3.0 - x_m) ** 2 + (0.5 - z_m) ** 2)
        return 4 * CONCRETE_REFLECTIVITY * cosine2

    expected_m2, _ = dblquad(density, -4.0, 4.0, 0.0, 3.0)

    # Midpoints of cells err by the second derivative: below 1 % at this distance.
    assert cross_sections_m2(wall, radar_m).sum() == pytest.approx(expected_m2, rel=0.01)


def test_concrete_reflects_as_its_permittivity():
    root = math.sqrt(5.24)  # ITU-R P.2040-3, table 3
    assert pytest.approx(((root - 1) / (root + 1)) ** 2, rel=3e-3) == CONCRETE_REFLECTIVITY


@pytest.mark.parametrize("height_m", [1.3, 3.0, 3.9])
def test_pole_reflects_like_a_long_cylinder(height_m):
    # Flat along and curved across: pi rho d, half of a guard rail with two waves. The ends are at
    # u = 2 * 1.3 / sqrt(0.0039 * 25) = 8.3 or more, where each has a ripple of sqrt(2) / (pi u).
    pole = Pole(radius_m=0.08, height_m=6.0)

    rcs_m2 = cross_sections_m2(pole, (-20.0, 15.0, height_m))

    assert rcs_m2.sum() == pytest.approx(math.pi * 0.08 * 25.0, rel=0.09)
    heights_m = pole.scatterer_offsets_m(np.zeros(1))[0, :, 2]
    assert heights_m @ rcs_m2 / rcs_m2.sum() == pytest.approx(height_m, abs=0.26)
    assert cross_sections_m2(pole, (-20.0, 15.0, 7.5)).sum() == 0


BODIES_WITH_FLASH = {
    "wall": (
        Wall(length_m=12.0, width_m=0.4, height_m=3.0, reflectivity=1.0, scattering=0.0),
        lambda along_m, distance_m: (along_m, distance_m + 0.2, 0.5),
        lambda distance_m: math.pi * distance_m**2,
        6.0,
    ),
    "pole": (
        Pole(radius_m=0.08, height_m=12.0),
        lambda along_m, distance_m: (distance_m, 0.0, along_m + 6.0),
        lambda distance_m: math.pi * 0.08 * distance_m,
        6.0,
    ),
    "guard-rail": (
        GuardRail(length_m=12.0, post_rcs_m2=1e-18),
        lambda along_m, distance_m: (along_m, distance_m, 0.6),
        lambda distance_m: 2 * math.pi * 0.05 * distance_m,
        6.0,
    ),
}


@pytest.mark.parametrize("along_m", [-3.1, 0.0, 0.13, 4.6, 5.9])
@pytest.mark.parametrize("distance_m", [3.0, 20.0, 60.0])
@pytest.mark.parametrize("name", nightly_except(1, BODIES_WITH_FLASH))
def test_flash_has_the_level_of_physical_optics(name, along_m, distance_m):
    body, place, level_m2, half_length_m = BODIES_WITH_FLASH[name]
    radar_m = np.array(place(along_m, distance_m))

    rcs_m2 = cross_sections_m2(body, radar_m)

    # The echoes of all points add up with their phases.
    ranges_m = np.linalg.norm(radar_m - body.scatterer_offsets_m(np.zeros(1))[0], axis=1)
    echo = np.sum(np.sqrt(rcs_m2) * np.exp(-4j * np.pi * ranges_m / WAVELENGTH_M))
    # Integral of the phase along the line, over that of a line without ends; 20 steps a wavelength.
    places_m = np.linspace(-half_length_m, half_length_m, 200_001)
    detours_m = np.hypot(distance_m, places_m - along_m) - distance_m
    integral = np.trapezoid(np.exp(-4j * np.pi * detours_m / WAVELENGTH_M), places_m)
    share = abs(integral) ** 2 / (WAVELENGTH_M * distance_m / 2)
    # 0.2 dB: the ripple of ends at more than half the distance has other phases at higher orders.
    assert abs(echo) ** 2 == pytest.approx(share * level_m2(distance_m), rel=0.047)


def test_foliage_is_an_ellipsoid_of_constant_gamma():
    tree = Foliage(length_m=4.0, width_m=3.0, height_m=8.0, base_height_m=2.0, gamma=0.1)
    offsets_m = tree.scatterer_offsets_m(np.zeros(1))[0]

    assert tree.cross_sections_m2().sum() == pytest.approx(
        0.1 * math.pi / 4 * math.sqrt(12.0) * 6.0, rel=1e-12
    )
    radii = np.linalg.norm((offsets_m - [0, 0, 5.0]) / [2.0, 1.5, 3.0], axis=1)
    assert 0.9 < radii.max() <= 1
    # Uniform in volume: 1/8 of the points within half the radius, by 5 standard deviations.
    n = len(offsets_m)
    assert abs((radii < 0.5).sum() - n / 8) < 5 * math.sqrt(n * 7 / 64)


@pytest.mark.parametrize(
    ("build_body", "message"),
    [
        (lambda: Wall(length_m=0, width_m=1, height_m=1), "Wall.length_m: 0"),
        (lambda: Wall(length_m=1, width_m=1, height_m=1, scattering=2), "Wall.scattering: 2"),
        (lambda: Wall(length_m=1, width_m=1, height_m=1, is_overhead=3), "Wall.is_overhead: 3"),
        (lambda: Pole(radius_m=-1), "Pole.radius_m: -1"),
        (lambda: Foliage(base_height_m=9), "Foliage.base_height_m: 9 m"),
    ],
)
def test_impossible_structures_are_refused(build_body, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        build_body()
