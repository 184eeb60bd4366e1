"""Bodies shadow each other, by diffraction at their edges."""

import tracemalloc
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

import dechirp as dc
from dechirp.core.compiled_kernels import plain_twins_for_small_work
from dechirp.evaluation.score.probabilities import DetectionProbability
from dechirp.impairments import TwoRayGround, WallMultipath
from dechirp.report.page import render_report
from dechirp.scene.scene_warnings import scene_findings
from dechirp.scene.screens import Screens, screens_of_bodies
from dechirp.scene.shadow_kernel import edge_field, edge_field_table
from dechirp.scene.shadowing import (
    SHADOWED_LOSS,
    scatterer_shadow_gains,
    shadowed_amplitudes,
)
from dechirp.theory.knife_edge import field_beyond_edge, knife_edge_field, knife_edge_loss_db
from nightly import nightly, nightly_except

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")

EXAMPLES = Path(__file__).parents[2] / "examples"
WAVELENGTH_M = 0.0039
FAR_M = 1e4


def one_screen(x, y, z):
    """Return a box from x[0] to x[1], y[0] to y[1], z[0] to z[1], of target 0."""
    corners_m = np.array([[complex(x[i], y[j]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]])
    return Screens(corners_m, np.array([[z]], dtype=float), np.array([0]))


def amplitude(antenna_m, position_m, screens):
    return shadowed_amplitudes(
        np.array([antenna_m], float), np.array([position_m], float), np.array([1]), screens,
        WAVELENGTH_M,
    ).item()  # fmt: skip


@pytest.fixture
def radar():
    """Return a radar of one transmitter and one receiver at the origin, 77 GHz."""
    array = "radar.array={tx: [[0, 0, 0]], rx: [[0, 0, 0]]}"
    return dc.load(EXAMPLES / "crossing.yaml", [array, "tracker=null", "chain.cluster=null"]).radar


def echo_power(scene, radar, *impairments):
    samples = dc.simulate(scene, radar, impairments=impairments, dtype=np.complex128).values
    return float(np.mean(abs(samples) ** 2))


def test_knife_edge_loss_is_that_of_p526():
    v = np.linspace(-3, 5, 81)
    exact = []
    for value in v.tolist():
        c, s = mpmath.fresnelc(value), mpmath.fresnels(value)
        exact.append(float(-20 * mpmath.log10(mpmath.sqrt((1 - c - s) ** 2 + (c - s) ** 2) / 2)))
    np.testing.assert_allclose(knife_edge_loss_db(v), exact, atol=1e-9)
    # Equation 31 of P.526, above v = -0.78.
    high = v[v > -0.78] - 0.1
    approximate = 6.9 + 20 * np.log10(np.sqrt(high**2 + 1) + high)
    assert abs(knife_edge_loss_db(v[v > -0.78]) - approximate).max() < 0.13


def test_knife_edge_loss_is_that_of_blockage_model_b_in_shadow():
    # TR 38.901, 7.6.4.2: F of an edge with the detour v^2 lambda / 4, and 1/2 for the others.
    v = np.linspace(0, 10, 41)
    blockage_b_db = -20 * np.log10(0.5 - np.arctan(np.pi**1.5 / 4 * v) / np.pi)
    assert abs(knife_edge_loss_db(v) - blockage_b_db).max() < 0.2


@pytest.mark.parametrize("edge", ["left", "right", "top", "bottom"])
@pytest.mark.parametrize("d1_m", [2.0, 20.0, 45.0])
def test_box_with_one_edge_near_the_path_is_a_knife_edge(edge, d1_m):
    v = np.linspace(-3, 5, 33)
    h_m = v / np.sqrt(2 / WAVELENGTH_M * (1 / d1_m + 1 / (50 - d1_m)))
    for value, height_m in zip(v, h_m, strict=True):
        y, z = [-FAR_M, FAR_M], [-FAR_M, FAR_M]
        if edge in ("left", "right"):
            y[["right", "left"].index(edge)] = height_m if edge == "left" else -height_m
        else:
            z[["bottom", "top"].index(edge)] = height_m if edge == "top" else -height_m
        found = amplitude((0, 0, 0), (50, 0, 0), one_screen((d1_m, d1_m), y, z))
        # Opposite edges, at v of 1e5, add 1e-5.
        assert abs(20 * np.log10(found) + knife_edge_loss_db(value)) < 0.01


def test_distances_along_an_inclined_path_count_in_three_dimensions():
    # From a gantry 20 m high down to 50 m: v from the distances along the path, across it.
    d = np.hypot(50, 20)
    for height_m in (-0.1, 0.1, 0.3):
        screen = one_screen((20, 20), (-FAR_M, FAR_M), (-np.inf, 12 + height_m))
        v = height_m * 50 / d * np.sqrt(2 / WAVELENGTH_M * (1 / (0.4 * d) + 1 / (0.6 * d)))
        found = amplitude((0, 0, 20), (50, 0, 0), screen)
        assert found == pytest.approx(abs(knife_edge_field(v)), rel=1e-3)


def test_field_of_the_table_is_that_of_the_integrals():
    table = edge_field_table()
    v = np.concatenate([np.linspace(-12, 12, 1501), [-1e7, -2e5, 300.0, 1e7]])

    fields = np.array([edge_field(value, table) for value in v.tolist()])

    # Cubic pieces of 1/128 err by (8 pi)^3 / sqrt(2) / 384 / 128^4 = 1.1e-7 at v = 8.
    assert abs(fields - field_beyond_edge(v)).max() < 1.2e-7
    assert [edge_field(value, table) for value in (-np.inf, np.inf)] == [1, 0]


@pytest.mark.parametrize("has_road", [False, True])
def test_compiled_loop_equals_its_plain_twin(has_road):
    # Boxes on both sides of the array, around scatterers, and at their ends; with images in a road.
    rng = np.random.default_rng(8)
    antennas_m = rng.normal(0, 0.01, (5, 3))
    positions_m = rng.uniform([2, -20, -0.5], [80, 20, 3], (400, 3))
    middles_m = rng.uniform(-5, 70, 30) + 1j * rng.uniform(-15, 15, 30)
    corners_m = np.array([-1 - 1j, 1 - 1j, 1 + 1j, -1 + 1j]) * rng.uniform(0.2, 4, (30, 1))
    corners_m = middles_m[:, None] + corners_m * np.exp(1j * rng.uniform(0, 6, (30, 1)))
    bands_m = np.sort(rng.uniform(-0.5, 3, (30, 1, 2)))
    bands_m[::3, 0, 0] = -np.inf
    if has_road:
        bands_m = np.concatenate([-1.0 - bands_m[:, :, ::-1], bands_m], axis=1)
    screens = Screens(corners_m, bands_m, np.arange(30))
    targets = np.repeat(np.arange(40), 10)

    compiled = shadowed_amplitudes(antennas_m, positions_m, targets, screens, WAVELENGTH_M)
    with plain_twins_for_small_work(0):
        plain = shadowed_amplitudes(antennas_m, positions_m, targets, screens, WAVELENGTH_M)

    assert 0.05 < (plain < 0.5).mean() < 0.95
    # Two fields of each of two pairs of edges, within 1.2e-7.
    assert abs(compiled - plain).max() < 1e-6
    assert np.array_equal(compiled == 1, plain == 1)


def test_paths_are_reciprocal():
    rng = np.random.default_rng(1)
    n_shadowed = 0
    for _ in range(200):
        corners_m = 20 + 4 * np.exp(2j * np.pi * (rng.random() + np.arange(4) / 4))
        screens = Screens(corners_m[None], np.array([[[-1.0, rng.random()]]]), np.array([0]))
        start_m, end_m = rng.normal([(0, 0, 0), (50, 0, 0)], [1, 4, 0.3])
        there = amplitude(start_m, end_m, screens)
        assert amplitude(end_m, start_m, screens) == pytest.approx(there, rel=1e-9)
        n_shadowed += there < 0.5
    assert 20 < n_shadowed < 180


def test_screens_before_beyond_and_far_beside_a_path_leave_it_exactly():
    for x, y in (
        ((-9, -1), (-1, 1)),
        ((51, 60), (-1, 1)),
        ((20, 30), (2, 9)),
        ((20, 30), (-9, -2)),
    ):
        assert amplitude((0, 0, 0), (50, 0, 0), one_screen(x, y, (-1, 1))) == 1


def test_scatterer_beside_a_long_screen_sees_its_near_corner():
    # A wall from 20 m on to beyond the scatterer: one vertical edge.
    screen = one_screen((20, 90), (0.1, 5), (-np.inf, np.inf))
    v = 0.1 * np.sqrt(2 / WAVELENGTH_M * (1 / 20 + 1 / 30))
    assert amplitude((0, 0, 0), (50, 0, 0), screen) == pytest.approx(
        abs(knife_edge_field(-v)), rel=1e-3
    )


def test_amplitude_is_continuous_as_scatterer_moves_behind_a_box():
    screen = one_screen((15, 25), (-2, 2), (-np.inf, 1.0))
    y_m = np.linspace(-9, 9, 4001)  # 4.5 mm, dv < 0.04
    positions_m = np.stack([np.full_like(y_m, 40), y_m, np.zeros_like(y_m)], axis=1)
    (found,) = shadowed_amplitudes(
        np.zeros((1, 3)), positions_m, np.ones(len(y_m), int), screen, WAVELENGTH_M
    )
    # |dF/dv| is at most 1 / sqrt(2), of two edges with a product of at most 1.2.
    assert abs(np.diff(found)).max() < 0.04
    assert found[0] == found[-1] == 1 and found[2000] < 0.1


def test_antennas_of_an_array_differ_at_the_edge_of_a_shadow():
    antennas_m = np.array([[0, y, 0] for y in np.linspace(-0.05, 0.05, 5)])
    screen = one_screen((15, 25), (-9, 0), (-np.inf, np.inf))
    y_m = np.linspace(-3, 3, 61)
    positions_m = np.stack([np.full_like(y_m, 40), y_m, np.zeros_like(y_m)], axis=1)
    together = shadowed_amplitudes(antennas_m, positions_m, np.ones(61, int), screen, WAVELENGTH_M)
    alone = np.array(
        [
            [amplitude(antenna, position, screen) for position in positions_m]
            for antenna in antennas_m
        ]
    )
    # The tolerance is 0.2 dB where antennas share an amplitude.
    assert abs(20 * np.log10(together / alone)).max() < 0.3
    assert np.ptp(20 * np.log10(together), axis=0).max() > 3


def test_echo_is_attenuated_out_and_back(radar):
    truck = dc.Target(position_m=(15, 0, -0.5), heading_rad=np.pi / 2, body=dc.bodies.Truck())
    for y_m in (0.0, 10.0, 17.0, 18.0, 25.0):
        point = dc.Target(name="point", position_m=(30, y_m, 0), rcs_m2=10.0)
        scene = dc.Scene(targets=[truck, point])
        samples = [
            dc.simulate(item, radar, impairments=[], dtype=np.complex128).values
            for item in (scene, dc.Scene(targets=[truck]), dc.Scene(targets=[point]))
        ]
        ratio = np.mean(abs(samples[0] - samples[1]) ** 2) / np.mean(abs(samples[2]) ** 2)
        truth = dc.truth(scene, radar).isel(frame=0)
        # The samples of 60 dB weaker echoes are accurate to 1e-9 of the truck's.
        assert 10 * np.log10(ratio * truth.shadow_loss[1]) == pytest.approx(0, abs=0.1)
        alone = dc.truth(dc.Scene(targets=[point]), radar).snr.item()
        assert truth.snr[1] * truth.shadow_loss[1] == pytest.approx(alone)
        assert truth.shadow_loss[0] == 1  # the truck does not shadow itself


def test_target_behind_a_truck_disappears_and_reappears_within_one_frame_of_geometry(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=0.1))
    truck = dc.bodies.Truck(length_m=8.0, wheel_radius_m=0.3)
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=(15, 0, -0.5), heading_rad=np.pi / 2, body=truck),
            dc.Target(name="car", position_m=(25, -10, 0), velocity_m_per_s=(0, 5, 0), rcs_m2=10.0),
        ]
    )
    n_frames = 41
    truth = dc.truth(scene, radar, n_frames=n_frames)
    detections = dc.detect(dc.simulate(scene, radar, n_frames=n_frames, seed=3), radar)
    detected = np.zeros(n_frames, dtype=bool)
    near = abs(detections.range.values - truth.range[1].values[detections.frame.values]) < 1
    detected[detections.frame.values[near]] = True
    # The sides of the shadow pass the near corners of the truck.
    y_m = -10 + 5 * truth.time.values
    edge_m = 4 * 25 / (15 - truck.width_m / 2)
    hidden = abs(y_m) < edge_m
    assert 10 < hidden.sum() < 40
    for is_gone in (~detected, truth.shadow_loss[1].values > SHADOWED_LOSS):
        assert np.flatnonzero(is_gone).tolist() == list(
            range(is_gone.argmax(), n_frames - is_gone[::-1].argmax())
        )
        assert abs(is_gone.argmax() - hidden.argmax()) <= 1
        assert abs(is_gone[::-1].argmax() - hidden[::-1].argmax()) <= 1


def test_car_is_hidden_part_by_part(radar):
    losses = []
    for y_m in (0.0, 6.5, 8.0, 20.0):
        targets = [
            dc.Target(position_m=(15, 0, -0.5), heading_rad=np.pi / 2,
                      body=dc.bodies.Truck(length_m=8.0, wheel_radius_m=0.3)),
            dc.Target(position_m=(25, y_m, -0.5), heading_rad=np.pi / 2, body=dc.bodies.Car()),
        ]  # fmt: skip
        scene = dc.Scene(targets=targets)
        losses.append(dc.truth(scene, radar).shadow_loss.values[1, 0])
        gains = scatterer_shadow_gains(scene, 0.0, WAVELENGTH_M)
        hidden = (gains < 1 / SHADOWED_LOSS)[scene.target_index_of_scatterer == 1].mean()
        assert hidden == {0.0: 1.0, 20.0: 0.0}.get(y_m, pytest.approx(0.5, abs=0.45))
    assert losses[0] > 1e3 and 1.1 < losses[2] < 16 and losses[3] == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(
    "targets",
    [
        [dc.Target(position_m=(20, 0, -0.5), body=dc.bodies.Truck())],
        [dc.Target(position_m=(20, y, 0)) for y in (0, 0.1)] + [dc.Target(position_m=(40, 0, 0))],
        [
            dc.Target(position_m=(x, 0, 0), body=dc.bodies.PointCloud(
                positions_m=((0, -1, 0), (0, 1, 0)), rcs_m2=(1, 1)))
            for x in (20, 30)
        ],
    ],
    ids=["one-body", "points", "point-clouds"],
)  # fmt: skip
def test_scene_without_bodies_that_shadow_others_is_unchanged(radar, targets):
    scene = dc.Scene(targets=targets)
    cubes = [
        dc.simulate(item, radar, seed=1).values for item in (scene, replace(scene, shadowing=False))
    ]
    np.testing.assert_array_equal(*cubes)


def test_shadowing_can_be_switched_off(radar):
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=(15, 0, -0.5), body=dc.bodies.Truck()),
            dc.Target(position_m=(40, 0, 0)),
        ],
        shadowing=False,
    )
    assert "shadow_loss" not in dc.truth(scene, radar)
    with pytest.raises(dc.InvalidSetting, match=r"Scene\.shadowing"):
        dc.Scene(shadowing=1)


def test_radar_inside_a_body_is_refused_with_its_name(radar):
    targets = [dc.Target(name="host", position_m=(0, 0, -0.5), body=dc.bodies.Car())]
    with pytest.raises(dc.InvalidSetting, match=r"targets\.host\.position.*around the radar"):
        dc.simulate(dc.Scene(targets=targets), radar)
    dc.simulate(dc.Scene(targets=targets, shadowing=False), radar)
    # On the bumper, the radar is outside.
    on_bumper = [replace(targets[0], position_m=(-2.5, 0, -0.5))]
    dc.simulate(dc.Scene(targets=on_bumper), radar)


def test_wall_shadows_what_is_behind_its_end(radar):
    wall = WallMultipath(start_m=(20, 2), end_m=(20.001, 40))
    for y_m in (4.0, 4.7, 5.3, 6.0):
        scene = dc.Scene(targets=[dc.Target(position_m=(50, y_m, 0))])
        ratio = echo_power(scene, radar, wall) / echo_power(scene, radar)
        r = np.hypot(50, y_m)
        offset_m = (2 * 50 - 20 * y_m) / r  # of the end, to the left of the path
        d1 = (20 * 50 + 2 * y_m) / r
        v = -offset_m * np.sqrt(2 / radar.frame.chirp.wavelength_m * (1 / d1 + 1 / (r - d1)))
        # The other end, at v = 250, adds a field of 0.001.
        assert ratio == pytest.approx(float(abs(knife_edge_field(v)) ** 4), rel=0.03)


@pytest.mark.parametrize("offset_m", nightly_except(1, [0.0, 0.1, 0.25, 0.6]))
def test_beam_of_a_guard_rail_shadows_what_is_behind_it(radar, offset_m):
    # The path crosses the beam of 0.31 m at half of its length of 20 m; the beam is a strip, over
    # and under which the field is that of a knife edge (P.526, 4.1).
    rail = dc.bodies.GuardRail(length_m=60.0)
    low_m, high_m = rail.blocking_box_m[:, 2]
    middle_m = (low_m + high_m) / 2
    blocker = dc.Target(
        name="rail", position_m=(10, 0, offset_m - middle_m), heading_rad=np.pi / 2, body=rail
    )
    point = dc.Target(name="point", position_m=(20, 0, 0))
    # Fluctuations are those of the second target in both scenes.
    shadowed, free = (
        np.subtract(
            *(
                dc.simulate(
                    dc.Scene(targets=targets, shadowing=shadowing), radar, dtype=np.complex128
                ).values
                for targets in ([blocker, point], [blocker])
            )
        )
        for shadowing in (True, False)
    )
    ratio = np.mean(abs(shadowed) ** 2) / np.mean(abs(free) ** 2)

    scale = np.sqrt(2 / radar.frame.chirp.wavelength_m * (1 / 10 + 1 / 10))
    over, under = offset_m + (high_m - low_m) / 2, (high_m - low_m) / 2 - offset_m
    field = knife_edge_field(over * scale) + knife_edge_field(under * scale)
    # 0.2 dB of the two-way level: the box is 0.1 m thick.
    assert 10 * np.log10(ratio) == pytest.approx(40 * np.log10(abs(field)), abs=0.2)


def test_radar_sees_below_a_vehicle_by_the_road_reflection(radar):
    # The gap of 0.375 m, and its image, are 2.7 zones high, at the middle between both ends.
    truck = dc.bodies.Truck(length_m=20.0, width_m=2.0, height_m=4.0, wheel_radius_m=0.75)
    blocker = dc.Target(position_m=(20, 0, -0.5), heading_rad=np.pi / 2, body=truck)
    point = dc.Target(name="point", position_m=(40, 0, 0))
    road = TwoRayGround(height_m=0.5, permittivity=1e6, polarisation="horizontal")
    powers = {}
    for name, impairments in (("dry", ()), ("road", (road,))):
        both, alone, behind = (
            dc.simulate(dc.Scene(targets=targets), radar, impairments=impairments,
                        dtype=np.complex128).values
            for targets in ([blocker, point], [blocker], [point])
        )  # fmt: skip
        powers[name] = np.mean(abs(both - alone) ** 2)
        powers[f"{name} free"] = np.mean(abs(behind) ** 2)
    assert powers["dry"] < 1e-5 * powers["dry free"]

    # The direct path runs 12.5 cm above the lower edge of the truck, that from the image of the
    # radar through the gap and its image. Both have the edges of the front or the back, whichever
    # are nearer: at 19 and 21 m of 40 m.
    def parameter(height_m, d1_m):
        return height_m * np.sqrt(2 / radar.frame.chirp.wavelength_m * (1 / d1_m + 1 / (40 - d1_m)))

    direct = abs(1 - knife_edge_field(-parameter(0.125, 19)) + knife_edge_field(parameter(3.5, 19)))
    gap = abs(knife_edge_field(-parameter(0.35, 19)) - knife_edge_field(parameter(0.35, 21)))
    detour_m = np.hypot(40, 1) - 40
    wavelengths = detour_m / radar.frame.chirp.wavelength_m
    expected = abs(direct - gap * np.exp(-2j * np.pi * wavelengths)) ** 4
    assert powers["road"] / powers["dry free"] == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(
    ("position_m", "is_hidden"),
    [((7.5, 2.5, 0), True), ((22.5, 2.5, 0), True), ((22.5, 7.5, 0), False)],
    ids=["before-the-wall", "after-the-wall", "behind-the-wall"],
)
def test_body_shadows_path_via_a_wall(radar, position_m, is_hidden):
    # The path from the radar via (15, 5) to the target; the direct one passes 2.5 m beside.
    wall = WallMultipath(start_m=(14, 5), end_m=(16, 5))
    targets = [
        dc.Target(name="far", position_m=(30, 0, 0)),
        dc.Target(name="post", position_m=position_m, body=dc.bodies.Sphere(radius_m=0.7)),
    ]
    scene = dc.Scene(targets=targets)
    shares = []
    for item in (scene, replace(scene, shadowing=False)):
        both, post, direct = (
            dc.simulate(part, radar, impairments=impairments, dtype=np.complex128).values
            for part, impairments in (
                (item, [wall]), (replace(item, targets=targets[1:]), [wall]),
                (replace(item, targets=targets[:1]), []),
            )
        )  # fmt: skip
        shares.append(np.mean(abs(both - post - direct) ** 2) / np.mean(abs(direct) ** 2))
    # Two of three ghosts have half of the path via the wall.
    assert (shares[0] < 0.05 * shares[1]) == is_hidden
    assert is_hidden or shares[0] == pytest.approx(shares[1], rel=1e-6)


def test_degenerate_geometry_yields_finite_amplitudes():
    rng = np.random.default_rng(3)
    grid = np.array([-20, -2, -1, 0, 0, 1, 2, 20.0])  # many points on corners, sides and lines
    for _ in range(300):
        n = int(rng.integers(1, 6))
        x, y, z = np.sort(rng.choice(grid, (3, n, 2)), axis=-1)
        corners_m = x[:, [0, 1, 1, 0]] + 1j * y[:, [0, 0, 1, 1]]
        z[rng.random(n) < 0.3, 0] = -np.inf
        amplitudes = shadowed_amplitudes(
            rng.choice(grid, (3, 3)) * rng.choice([0.01, 1]), rng.choice(grid, (8, 3)),
            rng.integers(0, 8, 8), Screens(corners_m, z[:, None], np.arange(n)), WAVELENGTH_M,
        )  # fmt: skip
        # The largest ripple of a screen: 1.37 dB of each edge across its width and its height.
        assert np.isfinite(amplitudes).all()
        assert amplitudes.min() >= 0 and amplitudes.max() < 1.4**n * 1.2


@nightly
def test_thousand_bodies_take_bounded_memory(radar):
    sphere = dc.bodies.Sphere(radius_m=0.5)
    targets = [
        dc.Target(position_m=(5 + 3 * (index // 20), 3 * (index % 20 - 9.5), 0), body=sphere)
        for index in range(1000)
    ]
    tracemalloc.start()
    losses = dc.truth(dc.Scene(targets=targets), radar).shadow_loss.values[:, 0]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 300e6
    assert losses[5:15].max() < SHADOWED_LOSS < np.median(losses)


@nightly
def test_many_scatterers_behind_many_bodies_take_bounded_memory():
    screens = screens_of_bodies(
        dc.Scene(
            targets=[
                dc.Target(position_m=(10 + 6 * index, 0, 0), body=dc.bodies.Car())
                for index in range(100)
            ]
        ),
        0.0,
    )
    positions_m = np.array([1000, 0, 0]) + np.random.default_rng(2).normal(size=(10_000, 3))
    tracemalloc.start()
    found = shadowed_amplitudes(
        np.zeros((1, 3)), positions_m, np.full(10_000, 100), screens, WAVELENGTH_M
    )
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100e6  # 1e6 pairs of 100 numbers would be 800 MB
    assert found.max() < 1e-10


def test_detection_probability_counts_frames_without_shadow():
    truth = dc.truth(
        dc.Scene(
            targets=[
                dc.Target(position_m=(15, 0, -0.5), heading_rad=np.pi / 2, body=dc.bodies.Truck()),
                dc.Target(position_m=(30, 15, 0), velocity_m_per_s=(0, 25, 0)),
            ]
        ),
        dc.load(EXAMPLES / "crossing.yaml").radar,
        n_frames=8,
    )
    lit = truth.shadow_loss.values < SHADOWED_LOSS
    assert lit[0].all() and 0 < lit[1].sum() < 8
    context = SimpleNamespace(truth=truth, target_names=("truck", "car"), times_s=np.arange(8))
    result = SimpleNamespace(
        association=SimpleNamespace(target=np.array([1] * 8)), detections={"frame": np.arange(8)}
    )
    sums = DetectionProbability().trial_sums(result, context)
    assert sums.tolist() == [[0, 8], [lit[1].sum(), lit[1].sum()]]


def test_shadowed_targets_are_named_in_a_finding(radar):
    scene = dc.Scene(
        targets=[
            dc.Target(name="truck", position_m=(15, 0, -0.5), heading_rad=1.57,
                      body=dc.bodies.Truck()),
            dc.Target(name="hidden", position_m=(30, 0, 0)),
            dc.Target(name="lit", position_m=(10, 3, 0)),
        ]
    )  # fmt: skip
    findings = [finding for finding in scene_findings(scene, radar) if "shadow" in finding.value]
    assert [finding.setting for finding in findings] == ["scene.targets.hidden.position"]


def test_boxes_follow_the_heading_of_bodies():
    target = dc.Target(position_m=(20, 1, -0.5), heading_rad=np.pi / 2, body=dc.bodies.Car())
    screens = screens_of_bodies(dc.Scene(targets=[target]), 0.0)
    assert sorted(screens.corners_m[0].real) == pytest.approx([19, 19, 21, 21])
    assert sorted(screens.corners_m[0].imag) == pytest.approx([-1.5, -1.5, 3.5, 3.5])
    np.testing.assert_allclose(screens.bands_m, [[[-np.inf, 1.1]]])


@nightly
def test_report_states_that_a_missed_target_is_shadowed():
    scenario = dc.load(
        EXAMPLES / "crossing.yaml",
        [
            "tracker=null", "chain.cluster=null", "n_frames=1", "radar.frame.n_chirps=32",
            "scene.targets=[{name: truck, position: [15 m, 0, -0.5 m], heading: 90 deg,"
            " body: {kind: truck}}, {name: hidden, position: [30 m, 0, 0]}]",
        ],
    )  # fmt: skip
    assert "no, shadowed by 76 dB" in render_report(dc.run(scenario), yaml="name: crossing\n")


@nightly
def test_statistical_sensor_draws_no_detections_of_shadowed_targets():
    scenario = dc.load(
        EXAMPLES / "crossing.yaml",
        [
            "tracker=null", "chain.cluster=null", "n_frames=4", "radar.frame.n_chirps=64",
            "scene.targets=[{name: sphere, position: [5 m, 0, 0],"
            " body: {kind: sphere, radius: 50 cm}}, {name: hidden, position: [30 m, 0, 0]}]",
        ],
    )  # fmt: skip
    n_near = []
    for shadowing in (True, False):
        scene = replace(scenario.scene, shadowing=shadowing)
        detections = dc.studies.draw_statistical_detections(replace(scenario, scene=scene), seed=1)
        n_near.append(int((abs(detections.range - 30) < 1).sum()))
    assert n_near[0] == 0 and n_near[1] >= 4
