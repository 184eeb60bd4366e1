"""Sphere, plate, corner reflector and guard rail, against other ways to the same numbers."""

import math

import numpy as np
import pytest
from scipy.special import spherical_jn, spherical_yn

import dechirp as dc
from dechirp.config.loading import parse_settings
from dechirp.radar.budget import received_power_w
from dechirp.scene.bodies.corner_reflector import CornerReflector
from dechirp.scene.bodies.guard_rail import GuardRail
from dechirp.scene.bodies.plate import Plate
from dechirp.scene.bodies.sphere import Sphere
from dechirp.scene.target import Target

WAVELENGTH_M = 299_792_458 / 77e9
AHEAD = np.array([[10.0, 0.0, 0.0]])


def decibels(power):
    return 10 * np.log10(power)


def towards(azimuth_deg, elevation_deg=0.0):
    """Unit vectors, (n, 3)."""
    azimuth, elevation = np.broadcast_arrays(np.radians(azimuth_deg), np.radians(elevation_deg))
    level = np.cos(elevation)
    vectors = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    return vectors.reshape(3, -1).T


def test_reflectors_have_the_cross_sections_of_the_reference_page():
    known = [(CornerReflector(edge_m=0.1), 14.4), (Sphere(radius_m=0.15), -11.5)]
    for body, level_db in known:
        assert decibels(body.cross_sections_towards_m2(AHEAD, WAVELENGTH_M)) == pytest.approx(
            np.array([[level_db]]), abs=0.05
        )


def mie(size):
    """Backscatter of a sphere of metal over pi r^2, by its circumference in wavelengths."""
    n = np.arange(1, math.ceil(size + 10 + 4 * size ** (1 / 3)))
    j, before = spherical_jn(n, size), spherical_jn(n - 1, size)
    h, h_before = j - 1j * spherical_yn(n, size), before - 1j * spherical_yn(n - 1, size)
    a, b = j / h, (size * before - n * j) / (size * h_before - n * h)
    return abs(np.sum((-1.0) ** n * (2 * n + 1) * (a - b))) ** 2 / size**2


@pytest.mark.parametrize("radii", [2.0, 2.13, 2.31, 5.0, 20.2])
def test_a_sphere_reflects_as_the_series_of_mie_says(radii):
    radius_m = radii * WAVELENGTH_M
    exact_m2 = mie(2 * np.pi * radii) * np.pi * radius_m**2
    found_m2 = Sphere(radius_m=radius_m).cross_sections_towards_m2(AHEAD, WAVELENGTH_M)

    # Creeping waves: 0.45 dB at two wavelengths, less at more.
    assert decibels(found_m2 / exact_m2) == pytest.approx(np.zeros((1, 1)), abs=0.5)


def test_a_plate_reflects_what_physical_optics_integrates():
    plate, directions = (
        Plate(width_m=0.05, height_m=0.03),
        towards([0, 1, 3, 20, -7], [0, 2, -5, 0.5, 3]),
    )
    found_m2 = plate.cross_sections_towards_m2(25 * directions, WAVELENGTH_M)[:, 0]

    # Currents of twice the incident field, in the middles of cells of a fortieth of a wave.
    y_m, z_m = (((np.arange(n) + 0.5) / n - 0.5) * of for n, of in ((520, 0.05), (310, 0.03)))
    k = 2 * np.pi / WAVELENGTH_M
    for direction, rcs_m2 in zip(directions, found_m2, strict=True):
        field = np.exp(2j * k * (direction[1] * y_m[:, None] + direction[2] * z_m)).mean()
        area_m2 = 0.05 * 0.03 * direction[0]
        exact_m2 = 4 * np.pi * abs(area_m2 * field) ** 2 / WAVELENGTH_M**2
        peak_m2 = 4 * np.pi * (0.05 * 0.03 / WAVELENGTH_M) ** 2
        assert rcs_m2 == pytest.approx(exact_m2, abs=1e-4 * peak_m2)


def test_a_plate_flashes_along_its_normal_from_both_faces_and_not_along_itself():
    plate = Plate(width_m=0.3, height_m=0.2)
    ahead, behind, beside = plate.cross_sections_towards_m2(towards([0, 180, 90]), WAVELENGTH_M)[
        :, 0
    ]

    assert ahead == pytest.approx(4 * np.pi * (0.06 / WAVELENGTH_M) ** 2)
    assert behind == pytest.approx(ahead)
    assert beside < 1e-12 * ahead
    # The first null where the way there and back changes by a wavelength over the width.
    null_deg = np.degrees(np.arcsin(WAVELENGTH_M / (2 * 0.3)))
    assert plate.cross_sections_towards_m2(towards(null_deg), WAVELENGTH_M)[0, 0] < 1e-20 * ahead


def opening_m2(direction):
    """Opening of three reflections of a corner with edges of 1 m, for a ray along a direction.

    What enters at one place of the opening, projected along the ray, leaves at the place
    across the corner: both have to lie in the opening (Robertson).
    """
    edges = np.eye(3)  # its own axes
    across = np.linalg.svd(direction[None])[2][1:]  # two vectors across the ray
    corners = edges @ across.T
    side = np.linspace(-1, 1, 1201)
    points = np.stack(np.meshgrid(side, side), axis=-1)

    def inside(at):
        turns = []
        for i in range(3):
            (x, y), way = corners[(i + 1) % 3] - corners[i], at - corners[i]
            turns.append(x * way[..., 1] - y * way[..., 0])
        return np.all(np.array(turns) > 0, axis=0) | np.all(np.array(turns) < 0, axis=0)

    return np.count_nonzero(inside(points) & inside(-points)) * (side[1] - side[0]) ** 2


@pytest.mark.parametrize(
    ("azimuth_deg", "elevation_deg"), [(0, 0), (15, 0), (-15, 10), (5, -25), (0, 30), (35, 5)]
)
@pytest.mark.filterwarnings("ignore:Arrays of 2-dimensional vectors:DeprecationWarning")
def test_a_corner_reflects_by_what_enters_and_leaves_its_opening(azimuth_deg, elevation_deg):
    direction = towards(azimuth_deg, elevation_deg)
    edge_m = 0.1
    found_m2 = CornerReflector(edge_m=edge_m).cross_sections_towards_m2(
        5 * direction, WAVELENGTH_M
    )[0, 0]

    # In its own axes, the three edges: alike about the first of the body's.
    s2, s3, s6 = np.sqrt([2, 3, 6])
    edges = np.array([(1 / s3, 0, s2 / s3), (1 / s3, 1 / s2, -1 / s6), (1 / s3, -1 / s2, -1 / s6)])
    assert edges @ edges.T == pytest.approx(np.eye(3), abs=1e-12)
    area_m2 = opening_m2(edges @ direction[0]) * edge_m**2
    exact_m2 = 4 * np.pi * area_m2**2 / WAVELENGTH_M**2
    assert decibels(found_m2 / exact_m2) == pytest.approx(0, abs=0.1)  # cells of the grid


def test_a_corner_is_seen_through_its_opening_alone():
    corner = CornerReflector(edge_m=0.1)
    azimuths_deg = np.arange(-180.0, 180.0)
    found_m2 = corner.cross_sections_towards_m2(towards(azimuths_deg), WAVELENGTH_M)[:, 0]

    assert found_m2.argmax() == 180  # ahead
    assert found_m2 == pytest.approx(np.roll(found_m2[::-1], 1), rel=1e-9, abs=1e-12)
    assert not found_m2[abs(azimuths_deg) > 60].any()
    assert np.abs(np.diff(found_m2)).max() < 0.06 * found_m2.max()  # no steps
    half = azimuths_deg[found_m2 > found_m2.max() / 2]
    assert -half[0] == half[-1] == pytest.approx(20, abs=2)


def test_a_corner_that_faces_the_radar_echoes_by_the_radar_equation(radar):
    target = dc.Target(position_m=(10, 0, 0), heading_rad=np.pi, body=CornerReflector(edge_m=0.1))
    cube = dc.simulate(dc.Scene(targets=[target]), radar, impairments=())
    wavelength_m = radar.frame.chirp.wavelength_m
    expected_w = received_power_w(
        radar, range_m=10.0, rcs_m2=4 * np.pi * 1e-4 / (3 * wavelength_m**2)
    )

    assert np.mean(abs(cube.values) ** 2) == pytest.approx(float(expected_w), rel=1e-3)
    away = dc.Target(position_m=(10, 0, 0), heading_rad=0.0, body=target.body)
    with pytest.warns(
        dc.PhysicsWarning,
        match=r"target-1\.heading: a heading without any"
        r" reflection",
    ):
        assert not dc.simulate(dc.Scene(targets=[away]), radar, impairments=()).any()


@pytest.mark.parametrize(
    ("body", "name"),
    [
        (Sphere(radius_m=1.9 * WAVELENGTH_M), "Sphere.radius_m"),
        (Plate(width_m=0.3, height_m=0.005), "Plate.height_m"),
        (CornerReflector(edge_m=0.01), "CornerReflector.edge_m"),
    ],
)
def test_what_is_small_to_the_wave_is_refused(body, name):
    with pytest.raises(dc.InvalidSetting, match=rf"{name}: .* wavelengths"):
        body.cross_sections_towards_m2(AHEAD, WAVELENGTH_M)


def test_a_body_that_is_small_to_the_wave_is_told_by_the_name_of_its_target(radar):
    balls = [
        dc.Target(name=name, position_m=(20, 0, 0), body=Sphere(radius_m=radius_m))
        for name, radius_m in (("ball", 0.1), ("pea", 0.003))
    ]
    with pytest.raises(dc.InvalidSetting, match=r"^scene\.targets\.pea\.body\.radius: 0.003 m"):
        dc.simulate(dc.Scene(targets=balls), radar)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sphere(radius_m=-0.1), "Sphere.radius_m: -0.1"),
        (lambda: Plate(width_m=0.1, height_m=0), "Plate.height_m: 0"),
        (lambda: CornerReflector(edge_m=float("inf")), "CornerReflector.edge_m: inf"),
        (lambda: GuardRail(length_m=0), "GuardRail.length_m: 0"),
        (lambda: GuardRail(length_m=9, post_spacing_m=-2), "GuardRail.post_spacing_m: -2"),
        (lambda: GuardRail(length_m=9, wave_radius_m=0.7), "GuardRail.wave_radius_m: 0.7 m"),
    ],
)
def test_sizes_that_cannot_be_are_refused_by_name(make, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        make()


def test_settings_files_choose_reflectors_by_kind():
    found = parse_settings(
        "position: [20 m, 0 m, 0 m]\nbody: {kind: corner-reflector, edge: 10 cm}", Target
    )

    assert found.body == CornerReflector(edge_m=0.1)


RAIL = GuardRail(length_m=60)


def beam_of(rail, abreast_m, away_m, height_m=0.5):
    """Places along the beam, and what its points reflect to a radar, each (n,)."""
    at_m = rail.offsets_m(np.zeros(1))[0]
    seen_m2 = rail.cross_sections_towards_m2(
        np.array([[abreast_m, away_m, height_m]]), WAVELENGTH_M
    )[0]
    beam = at_m[:, 2] == rail.height_m
    return at_m[beam, 0], seen_m2[beam]


@pytest.mark.parametrize("away_m", [2.0, -4.0, 9.0])
def test_the_flash_of_a_guard_rail_goes_with_the_radar(away_m):
    for abreast_m in (-20.0, 0.1, 13.27):
        x_m, seen_m2 = beam_of(RAIL, abreast_m, away_m)
        # Two mirrors, of 5 cm across; 1.5 % from place to place.
        expected_m2 = 2 * np.pi * 0.05 * np.hypot(away_m, 0.1)
        assert seen_m2.sum() == pytest.approx(expected_m2, rel=0.02)
        assert np.sum(x_m * seen_m2) / seen_m2.sum() == pytest.approx(abreast_m, abs=0.05)
        assert seen_m2[abs(x_m - abreast_m) > 1.5].sum() < 1e-6 * expected_m2


def test_before_a_guard_rail_begins_there_is_no_flash():
    assert beam_of(RAIL, 40.0, 3.0)[1].sum() < 1e-12
    # At its end there is half of it, and half a point more.
    whole = beam_of(RAIL, 0.0, 3.0)[1].sum()
    assert beam_of(RAIL, 30.0, 3.0)[1].sum() == pytest.approx(0.9 * whole, rel=0.02)


def test_a_guard_rail_stands_on_posts_at_equal_distances():
    rail = GuardRail(length_m=20, post_spacing_m=4, post_rcs_m2=0.3)
    at_m = rail.offsets_m(np.zeros(1))[0]
    posts = at_m[:, 2] < rail.height_m

    assert at_m[posts, 0] == pytest.approx(np.array([-10, -6, -2, 2, 6, 10]))
    seen_m2 = rail.cross_sections_towards_m2(
        np.array([[-40.0, 3.0, 0.5], [0.0, -5.0, 0.5]]), WAVELENGTH_M
    )
    assert (seen_m2[:, posts] == 0.3).all()
    assert seen_m2.shape == (2, rail.n_scatterers())
