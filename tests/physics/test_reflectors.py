"""Sphere, plate, corner reflector and guard rail, against independent calculations."""

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
from nightly import nightly_except

WAVELENGTH_M = 299_792_458 / 77e9
RADAR_AHEAD_M = np.array([[10.0, 0.0, 0.0]])


def to_decibels(power):
    return 10 * np.log10(power)


def compute_directions(azimuth_deg, elevation_deg=0.0):
    """Compute unit vectors, (n, 3)."""
    azimuth, elevation = np.broadcast_arrays(np.radians(azimuth_deg), np.radians(elevation_deg))
    level = np.cos(elevation)
    vectors = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    return vectors.reshape(3, -1).T


def test_reflector_rcs_matches_published_levels():
    published_levels = [(CornerReflector(edge_m=0.1), 14.4), (Sphere(radius_m=0.15), -11.5)]
    for body, level_db in published_levels:
        assert to_decibels(
            body.cross_sections_towards_m2(RADAR_AHEAD_M, WAVELENGTH_M)
        ) == pytest.approx(np.array([[level_db]]), abs=0.05)


def compute_mie_backscatter(size):
    """Compute the backscatter of a metal sphere over pi r^2 from its circumference / wavelength."""
    n = np.arange(1, math.ceil(size + 10 + 4 * size ** (1 / 3)))
    j, j_before = spherical_jn(n, size), spherical_jn(n - 1, size)
    h, h_before = j - 1j * spherical_yn(n, size), j_before - 1j * spherical_yn(n - 1, size)
    a, b = j / h, (size * j_before - n * j) / (size * h_before - n * h)
    return abs(np.sum((-1.0) ** n * (2 * n + 1) * (a - b))) ** 2 / size**2


@pytest.mark.parametrize("radii", [2.0, 2.13, 2.31, 5.0, 20.2])
def test_sphere_rcs_matches_mie_series(radii):
    radius_m = radii * WAVELENGTH_M
    exact_m2 = compute_mie_backscatter(2 * np.pi * radii) * np.pi * radius_m**2
    rcs_m2 = Sphere(radius_m=radius_m).cross_sections_towards_m2(RADAR_AHEAD_M, WAVELENGTH_M)

    # Creeping waves: 0.45 dB at two wavelengths, less for larger spheres.
    assert to_decibels(rcs_m2 / exact_m2) == pytest.approx(np.zeros((1, 1)), abs=0.5)


def test_plate_rcs_matches_physical_optics_integral():
    plate, directions = (
        Plate(width_m=0.05, height_m=0.03),
        compute_directions([0, 1, 3, 20, -7], [0, 2, -5, 0.5, 3]),
    )
    plate_rcs_m2 = plate.cross_sections_towards_m2(25 * directions, WAVELENGTH_M)[:, 0]

    # Currents of twice the incident field at the centres of cells of lambda / 40.
    y_m, z_m = (
        ((np.arange(n) + 0.5) / n - 0.5) * side_m for n, side_m in ((520, 0.05), (310, 0.03))
    )
    k = 2 * np.pi / WAVELENGTH_M
    for direction, rcs_m2 in zip(directions, plate_rcs_m2, strict=True):
        field = np.exp(2j * k * (direction[1] * y_m[:, None] + direction[2] * z_m)).mean()
        area_m2 = 0.05 * 0.03 * direction[0]
        exact_m2 = 4 * np.pi * abs(area_m2 * field) ** 2 / WAVELENGTH_M**2
        peak_m2 = 4 * np.pi * (0.05 * 0.03 / WAVELENGTH_M) ** 2
        assert rcs_m2 == pytest.approx(exact_m2, abs=1e-4 * peak_m2)


def test_plate_reflects_along_normal_from_both_faces_only():
    plate = Plate(width_m=0.3, height_m=0.2)
    front_m2, back_m2, edge_m2 = plate.cross_sections_towards_m2(
        compute_directions([0, 180, 90]), WAVELENGTH_M
    )[:, 0]

    assert front_m2 == pytest.approx(4 * np.pi * (0.06 / WAVELENGTH_M) ** 2)
    assert back_m2 == pytest.approx(front_m2)
    assert edge_m2 < 1e-12 * front_m2
    # First null: the two-way path changes by one wavelength over the width.
    null_deg = np.degrees(np.arcsin(WAVELENGTH_M / (2 * 0.3)))
    assert (
        plate.cross_sections_towards_m2(compute_directions(null_deg), WAVELENGTH_M)[0, 0]
        < 1e-20 * front_m2
    )


def compute_opening_m2(direction):
    """Compute the effective triple-reflection opening of a corner with edges of 1 m.

    A ray that enters at one point of the projected opening leaves at the opposite point: both must
    lie in the opening (Robertson).
    """
    edges = np.eye(3)  # axes of the corner
    cross_vectors = np.linalg.svd(direction[None])[2][1:]  # two vectors across the ray
    corners = edges @ cross_vectors.T
    side = np.linspace(-1, 1, 1201)
    points = np.stack(np.meshgrid(side, side), axis=-1)

    def is_inside(points_m):
        cross_products = []
        for i in range(3):
            (x, y), offset_m = corners[(i + 1) % 3] - corners[i], points_m - corners[i]
            cross_products.append(x * offset_m[..., 1] - y * offset_m[..., 0])
        return np.all(np.array(cross_products) > 0, axis=0) | np.all(
            np.array(cross_products) < 0, axis=0
        )

    return np.count_nonzero(is_inside(points) & is_inside(-points)) * (side[1] - side[0]) ** 2


@pytest.mark.parametrize(
    ("azimuth_deg", "elevation_deg"),
    nightly_except(2, [(0, 0), (15, 0), (-15, 10), (5, -25), (0, 30), (35, 5)]),
)
@pytest.mark.filterwarnings("ignore:Arrays of 2-dimensional vectors:DeprecationWarning")
def test_corner_rcs_matches_effective_opening(azimuth_deg, elevation_deg):
    direction = compute_directions(azimuth_deg, elevation_deg)
    edge_m = 0.1
    rcs_m2 = CornerReflector(edge_m=edge_m).cross_sections_towards_m2(5 * direction, WAVELENGTH_M)[
        0, 0
    ]

    # Edges in body axes: symmetric about the body's first axis.
    s2, s3, s6 = np.sqrt([2, 3, 6])
    edges = np.array([(1 / s3, 0, s2 / s3), (1 / s3, 1 / s2, -1 / s6), (1 / s3, -1 / s2, -1 / s6)])
    assert edges @ edges.T == pytest.approx(np.eye(3), abs=1e-12)
    area_m2 = compute_opening_m2(edges @ direction[0]) * edge_m**2
    exact_m2 = 4 * np.pi * area_m2**2 / WAVELENGTH_M**2
    assert to_decibels(rcs_m2 / exact_m2) == pytest.approx(0, abs=0.1)  # grid resolution


def test_corner_reflects_through_its_opening_only():
    corner = CornerReflector(edge_m=0.1)
    azimuths_deg = np.arange(-180.0, 180.0)
    rcs_m2 = corner.cross_sections_towards_m2(compute_directions(azimuths_deg), WAVELENGTH_M)[:, 0]

    assert rcs_m2.argmax() == 180  # ahead
    assert rcs_m2 == pytest.approx(np.roll(rcs_m2[::-1], 1), rel=1e-9, abs=1e-12)
    assert not rcs_m2[abs(azimuths_deg) > 60].any()
    assert np.abs(np.diff(rcs_m2)).max() < 0.06 * rcs_m2.max()  # no steps
    beam_azimuths_deg = azimuths_deg[rcs_m2 > rcs_m2.max() / 2]
    assert -beam_azimuths_deg[0] == beam_azimuths_deg[-1] == pytest.approx(20, abs=2)


def test_corner_facing_radar_follows_radar_equation(radar):
    target = dc.Target(position_m=(10, 0, 0), heading_rad=np.pi, body=CornerReflector(edge_m=0.1))
    cube = dc.simulate(dc.Scene(targets=[target]), radar, impairments=())
    wavelength_m = radar.frame.chirp.wavelength_m
    expected_w = received_power_w(
        radar, range_m=10.0, rcs_m2=4 * np.pi * 1e-4 / (3 * wavelength_m**2)
    )

    assert np.mean(abs(cube.values) ** 2) == pytest.approx(float(expected_w), rel=1e-3)
    target_facing_away = dc.Target(position_m=(10, 0, 0), heading_rad=0.0, body=target.body)
    with pytest.warns(
        dc.PhysicsWarning,
        match=r"target-1\.heading: a heading without any"
        r" reflection",
    ):
        assert not dc.simulate(dc.Scene(targets=[target_facing_away]), radar, impairments=()).any()


@pytest.mark.parametrize(
    ("body", "name"),
    [
        (Sphere(radius_m=1.9 * WAVELENGTH_M), "Sphere.radius_m"),
        (Plate(width_m=0.3, height_m=0.005), "Plate.height_m"),
        (CornerReflector(edge_m=0.01), "CornerReflector.edge_m"),
    ],
)
def test_rejects_body_smaller_than_wavelengths(body, name):
    with pytest.raises(dc.InvalidSetting, match=rf"{name}: .* wavelengths"):
        body.cross_sections_towards_m2(RADAR_AHEAD_M, WAVELENGTH_M)


def test_rejection_of_small_body_gives_target_name(radar):
    spheres = [
        dc.Target(name=name, position_m=(20, 0, 0), body=Sphere(radius_m=radius_m))
        for name, radius_m in (("ball", 0.1), ("pea", 0.003))
    ]
    with pytest.raises(dc.InvalidSetting, match=r"^scene\.targets\.pea\.body\.radius: 0.003 m"):
        dc.simulate(dc.Scene(targets=spheres), radar)


@pytest.mark.parametrize(
    ("build_body", "message"),
    [
        (lambda: Sphere(radius_m=-0.1), "Sphere.radius_m: -0.1"),
        (lambda: Plate(width_m=0.1, height_m=0), "Plate.height_m: 0"),
        (lambda: CornerReflector(edge_m=float("inf")), "CornerReflector.edge_m: inf"),
        (lambda: GuardRail(length_m=0), "GuardRail.length_m: 0"),
        (lambda: GuardRail(length_m=9, post_spacing_m=-2), "GuardRail.post_spacing_m: -2"),
        (lambda: GuardRail(length_m=9, wave_radius_m=0.7), "GuardRail.wave_radius_m: 0.7 m"),
    ],
)
def test_rejects_invalid_sizes(build_body, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        build_body()


def test_settings_select_reflector_by_kind():
    target = parse_settings(
        "position: [20 m, 0 m, 0 m]\nbody: {kind: corner-reflector, edge: 10 cm}", Target
    )

    assert target.body == CornerReflector(edge_m=0.1)


GUARD_RAIL = GuardRail(length_m=60)


def compute_beam_rcs(rail, radar_x_m, radar_y_m, height_m=0.5):
    """Compute positions along the beam and their cross-sections towards a radar, each (n,)."""
    offsets_m = rail.scatterer_offsets_m(np.zeros(1))[0]
    rcs_m2 = rail.cross_sections_towards_m2(
        np.array([[radar_x_m, radar_y_m, height_m]]), WAVELENGTH_M
    )[0]
    is_beam = offsets_m[:, 2] == rail.height_m
    return offsets_m[is_beam, 0], rcs_m2[is_beam]


@pytest.mark.parametrize("radar_y_m", [2.0, -4.0, 9.0])
def test_guard_rail_reflection_follows_radar(radar_y_m):
    for radar_x_m in (-20.0, 0.1, 13.27):
        x_m, rcs_m2 = compute_beam_rcs(GUARD_RAIL, radar_x_m, radar_y_m)
        # Two cylindrical mirrors of 5 cm radius; the ends, 10 m away, change them by 0.5 %.
        expected_m2 = 2 * np.pi * 0.05 * np.hypot(radar_y_m, 0.1)
        assert rcs_m2.sum() == pytest.approx(expected_m2, rel=0.02)
        assert np.sum(x_m * rcs_m2) / rcs_m2.sum() == pytest.approx(radar_x_m, abs=0.26)


def test_guard_rail_does_not_reflect_beyond_its_end():
    assert compute_beam_rcs(GUARD_RAIL, 40.0, 3.0)[1].sum() < 1e-12
    # Abreast of the end, half of the amplitude remains.
    middle_m2 = compute_beam_rcs(GUARD_RAIL, 0.0, 3.0)[1].sum()
    assert compute_beam_rcs(GUARD_RAIL, 30.0, 3.0)[1].sum() == pytest.approx(
        middle_m2 / 4, rel=0.02
    )


def test_guard_rail_posts_are_equally_spaced():
    rail = GuardRail(length_m=20, post_spacing_m=4, post_rcs_m2=0.3)
    offsets_m = rail.scatterer_offsets_m(np.zeros(1))[0]
    is_post = offsets_m[:, 2] < rail.height_m

    assert offsets_m[is_post, 0] == pytest.approx(np.array([-10, -6, -2, 2, 6, 10]))
    rcs_m2 = rail.cross_sections_towards_m2(
        np.array([[-40.0, 3.0, 0.5], [0.0, -5.0, 0.5]]), WAVELENGTH_M
    )
    assert (rcs_m2[:, is_post] == 0.3).all()
    assert rcs_m2.shape == (2, rail.n_scatterers())
