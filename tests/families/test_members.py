"""Contract of each family, checked for every member."""

import os
import subprocess
import sys
import warnings
from dataclasses import MISSING, fields, replace
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.evaluation.score.base import Score
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.cfar.base import NoiseEstimator
from dechirp.processing.mitigation.base import Mitigation
from dechirp.radar.modulations.base import Modulation
from dechirp.radar.multiplexing.base import Multiplexing
from dechirp.radar.patterns.base import Pattern
from dechirp.recordings.readers.base import Format, MatchQuality
from dechirp.scene.bodies.base import Body
from dechirp.scene.bodies.points import Scatterer
from dechirp.scene.rcs import scatterer_cross_sections_m2
from dechirp.simulation.impairments.base import Impairment
from nightly import NIGHTLY, nightly_except
from noise_cubes import simulate_noise_cube

FAMILIES = [
    NoiseEstimator,
    DirectionEstimator,
    Mitigation,
    Impairment,
    Format,
    Modulation,
    Multiplexing,
    Pattern,
    Body,
    Score,
]
# Values of required settings. Phases rotate transmitters 2 and 3 by thirds of a turn.
REQUIRED_SETTINGS = {
    "max_range_m": 3.0,
    "rate_m_per_s": 7e-6,
    "water_kg_per_m3": 5e-4,
    "rms_s": 1e-10,
    "full_scale_w": 1e-9,
    "p1db_w": 1e-10,
    "isolation": 1e3,
    "speed_m_per_s": 0.0,
    "path": str(Path(__file__).parent / "box.obj"),
    "interferers": [
        dc.impairments.Interferer(
            start_frequency_hz=77e9,
            slope_hz_per_s=5e12,
            ramp_duration_s=30e-6,
            interval_s=33e-6,
            transmit_power_w=1e-3,
            antenna_gain=10.0,
            position_m=(30, 2, 0),
        )
    ],
    "order": (2, 0, 1),
    "n_sub_bands": 4,
    "step_hz": 2e8,
    "pauses_s": (0.0, 7e-6, 3e-6),
    "azimuth_rad": (-1, 0, 1),
    "gain": ((1, 10, 2),),
    "n_patches": 5,
    "design_frequency_hz": 77e9,
    "positions_m": [(0, 0, 0), (1, 0.5, 0)],
    "rcs_m2": [1.0, 2.0],
    "scatterers": [
        Scatterer(position_m=(0, 0, 0), rcs_m2=1.0),
        Scatterer(position_m=(1, 0.5, 0), rcs_m2=2.0),
    ],
    "phases_rad": [[0, k * 2 * np.pi / 3, -k * 2 * np.pi / 3] for k in range(3)],
}

# Settings of members whose defaults have no effect, or whose setting names are ambiguous.
EXAMPLE_SETTINGS = {
    "coloured-noise": {"beat_hz": (0.0, 4e6), "level": (1.0, 10.0)},
    "mutual-coupling": {"rx_level": 0.01},
    "iq-imbalance": {"gain": 1.02},
    "channel-mismatch": {"gain_std": 1.05},
    "phase-noise": {"offset_hz": (1e5, 1e6), "level_per_hz": (1e-8, 1e-9)},
    "pll": {"natural_frequency_hz": 3e5},
    "polynomial-nonlinearity": {"error_hz": (0.0, 0.0, 1e5)},
    "position-errors": {"std_m": 1e-4},
    "radome": {"film_m": 1e-4},
    "sinusoidal-nonlinearity": {"deviation_hz": 1e5, "rate_hz": 1e6},
    "wall-multipath": {"start_m": (-5, -4), "end_m": (50, -4)},
}


def build_example(member):
    """Build a member from its defaults; required settings have the value above, or 1."""
    required = [f.name for f in fields(member) if f.default is MISSING]
    settings = {name: REQUIRED_SETTINGS.get(name, 1.0) for name in required}
    return member(**{**settings, **EXAMPLE_SETTINGS.get(member.kind(), {})})


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.group)
def test_kind_of_member_is_its_class_name_in_lower_case(family):
    members = family.members()
    assert members
    separator = "_" if family is Score else "-"  # scores name variables of results
    for kind, member in members.items():
        assert kind.replace(separator, "") == member.__name__.lower()
        assert isinstance(build_example(member), family)


def test_entry_point_of_other_package_adds_member(tmp_path):
    (tmp_path / "always_three.py").write_text(
        "import numpy as np\n"
        "from dechirp.core.values import frozen_dataclass\n"
        "from dechirp.processing.cfar.base import NoiseEstimator\n\n\n"
        "@frozen_dataclass\n"
        "class AlwaysThree(NoiseEstimator):\n"
        "    def statistic(self, cells, offsets):\n"
        "        return np.full(cells.shape[:-1], 3.0)\n"
    )
    folder = tmp_path / "guest-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: guest\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(
        "[dechirp.cfar]\nalways-three = always_three:AlwaysThree\n"
    )
    # A separate process does not affect the members in this one.
    path = os.pathsep.join([str(tmp_path), str(Path(dc.__file__).parent.parent)])
    code = (
        "from dechirp.config.loading import parse_settings; from dechirp.processing.cfar.base"
        " import Cfar;"
        "print(parse_settings('estimator: {kind: always-three}\\noffset: 3 dB', Cfar).estimator)"
    )
    process = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    assert process.stdout.strip() == "AlwaysThree()"


@pytest.mark.parametrize("kind", nightly_except(2, NoiseEstimator.members()))
@pytest.mark.parametrize(
    "region", nightly_except(["middle"], ["middle", "first rows", "last rows"])
)
def test_false_alarm_rate_matches_setting_in_white_noise(radar, kind, region):
    estimator = build_example(NoiseEstimator.members()[kind])
    cfar = dc.Cfar(
        estimator=estimator,
        n_training=dc.Cells(range=6, velocity=4),
        n_guard=dc.Cells(range=1, velocity=1),
        false_alarm_probability=1e-2,
    )
    chain = dc.Chain(range_window="rectangular", doppler_window="rectangular", cfar=cfar)
    rows = {"middle": slice(20, -20), "first rows": slice(0, 7), "last rows": slice(-7, None)}
    rng = np.random.default_rng(61)
    hits = trials = 0
    for _ in range(60 if NIGHTLY else 30):
        power = dc.power_map(simulate_noise_cube(radar, rng).isel(frame=0), radar, chain)
        alarms = (power > dc.threshold_map(power, radar, chain)).values[:, rows[region]]
        hits, trials = hits + alarms.sum(), trials + alarms.size
    # Independent cells; their thresholds share training cells, which widens the spread by
    # less than 1.5: 268 alarms or more, five standard errors.
    spread = 1.5 * np.sqrt(1e-2 / trials)
    assert hits / trials == pytest.approx(1e-2, abs=5 * spread)


def make_uniform_linear_array(n):
    """Make a uniform linear array along y with half-wavelength spacing."""
    return Aperture(np.stack([np.zeros(n), np.arange(n) / 2, np.zeros(n)], axis=1))


def simulate_snapshots(azimuth, aperture, rng):
    """Simulate one snapshot per azimuth: 20 dB SNR per element, unit noise power."""
    shape = (len(azimuth), 1, aperture.n_elements)
    phase = np.exp(2j * np.pi * rng.uniform(size=(len(azimuth), 1)))
    noise = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    return (10 * phase * aperture.steering_vectors(azimuth))[:, None] + noise / np.sqrt(2)


@pytest.mark.parametrize("n_elements", [4, 8])
@pytest.mark.parametrize("kind", DirectionEstimator.members())
def test_direction_errors_match_stated_standard_deviation(kind, n_elements):
    estimator, aperture, n = (
        build_example(DirectionEstimator.members()[kind]),
        make_uniform_linear_array(n_elements),
        2000,
    )
    rng = np.random.default_rng(63)
    azimuth = rng.uniform(-0.8, 0.8, n)
    snapshots = simulate_snapshots(azimuth, aperture, rng).astype(np.complex64)
    directions = estimator.find_directions(snapshots, aperture, np.ones(n))

    error = (directions.azimuth_rad[:, 0] - azimuth) / directions.azimuth_std_rad[:, 0]
    # The mean of 2,000 squared normal errors has a standard error of 0.032.
    assert np.mean(error**2) == pytest.approx(1, abs=0.16)
    assert np.isnan(directions.elevation_rad).all() and np.isnan(directions.elevation_std_rad).all()
    # Noise shifts the mean of 20 dB by 0.01 dB.
    assert 10 * np.log10(np.mean(directions.power[:, 0])) == pytest.approx(20, abs=0.1)


@pytest.mark.parametrize("kind", DirectionEstimator.members())
def test_direction_is_independent_of_batch_unit_and_phase(kind):
    estimator, aperture = (
        build_example(DirectionEstimator.members()[kind]),
        make_uniform_linear_array(6),
    )
    rng = np.random.default_rng(64)
    snapshots = simulate_snapshots(rng.uniform(-0.8, 0.8, 8), aperture, rng)
    directions = estimator.find_directions(snapshots, aperture, np.ones(8))

    single = estimator.find_directions(snapshots[3:4], aperture, np.ones(1))
    scaled = estimator.find_directions(snapshots * 1e-6j, aperture, np.full(8, 1e-12))
    damaged_snapshots = snapshots.copy()
    damaged_snapshots[[1, 5]] = np.array([np.nan, 0])[:, None, None]
    damaged = estimator.find_directions(damaged_snapshots, aperture, np.ones(8))
    # A hundredth of a standard error.
    tolerance = 0.01 * np.nanmin(directions.azimuth_std_rad)
    assert single.azimuth_rad[0, 0] == pytest.approx(directions.azimuth_rad[3, 0], abs=tolerance)
    assert scaled.azimuth_rad == pytest.approx(directions.azimuth_rad, abs=tolerance)
    assert scaled.azimuth_std_rad == pytest.approx(directions.azimuth_std_rad, rel=0.02)
    assert scaled.power == pytest.approx(1e-12 * directions.power, rel=1e-3, abs=0)
    assert all(np.isnan(part[[1, 5]]).all() for part in damaged)
    assert damaged.azimuth_rad[[0, 7]] == pytest.approx(
        directions.azimuth_rad[[0, 7]], abs=tolerance
    )
    assert len(estimator.find_directions(snapshots[:0], aperture, np.ones(0)).power) == 0


@pytest.mark.parametrize("kind", DirectionEstimator.members())
def test_two_sources_are_sorted_by_power_or_rejected(kind):
    member, aperture = DirectionEstimator.members()[kind], make_uniform_linear_array(12)
    try:
        estimator = member(n_sources=2)
    except dc.InvalidSetting as error:
        assert "n_sources" in str(error)
        return
    azimuth, rng = np.array([-0.4, 0.5]), np.random.default_rng(65)
    amplitudes = np.array([10, 30]) * np.exp(2j * np.pi * rng.uniform(size=(50, 1, 2)))
    snapshots = amplitudes @ aperture.steering_vectors(azimuth)
    noise = rng.normal(size=snapshots.shape) + 1j * rng.normal(size=snapshots.shape)
    directions = estimator.find_directions(snapshots + noise / np.sqrt(2), aperture, np.ones(50))
    assert np.all(directions.power[:, 0] > directions.power[:, 1])
    # Spatial smoothing widens the beam and adds sidelobes of the stronger source.
    assert np.all(abs(np.sin(directions.azimuth_rad) - np.sin(azimuth[::-1])) < 0.1 / 6)


@pytest.mark.parametrize("kind", DirectionEstimator.members())
def test_direction_estimator_rejects_invalid_arguments(kind):
    member, aperture = DirectionEstimator.members()[kind], make_uniform_linear_array(3)
    with pytest.raises(dc.InvalidSetting, match="n_sources"):
        member(n_sources=3).find_directions(np.ones((1, 1, 3)), aperture, np.ones(1))
    for n_sources in (0, 1.5, "many"):
        with pytest.raises(dc.InvalidSetting, match="n_sources"):
            member(n_sources=n_sources)
    estimator = build_example(member)
    with pytest.raises(dc.InvalidSetting, match="snapshots"):
        estimator.find_directions(np.ones((1, 1, 4)), aperture, np.ones(1))
    for noise in (np.ones(2), np.array([np.nan]), np.array([-1.0])):
        with pytest.raises(dc.InvalidSetting, match="noise_power"):
            estimator.find_directions(np.ones((1, 1, 3)), aperture, noise)


@pytest.mark.parametrize("sampling", nightly_except(1, ["complex", "real"]))
@pytest.mark.parametrize("kind", Impairment.members())
def test_impairment_is_reproducible_for_same_seed(radar, kind, sampling):
    impairment = build_example(Impairment.members()[kind])
    # Leakage needs separate antennas; they are 0.3 m above the ground.
    array = dc.Array(tx_m=[(0, 0.01, 0.3)], rx_m=[(0, 0, 0.3), (0, 0.002, 0.3)])
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, array=array, frame=replace(radar.frame, chirp=chirp))
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0.5))])
    if kind == "body-multipath":
        wall = dc.bodies.Wall(length_m=30, width_m=0.5, height_m=3)
        scene = replace(
            scene, targets=(*scene.targets, dc.Target(position_m=(18, 5, 0), body=wall))
        )
    if sampling == "real" and kind == "iq-imbalance":
        with pytest.raises(dc.InvalidSetting, match="real"):
            dc.simulate(scene, radar, impairments=[impairment])
        return
    ideal_cube = dc.simulate(scene, radar, impairments=(), n_frames=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)
        cube, repeated_cube = (
            dc.simulate(scene, radar, impairments=[impairment], n_frames=2, seed=62)
            for _ in range(2)
        )

    assert cube.shape == ideal_cube.shape and cube.dtype == ideal_cube.dtype
    assert np.isfinite(cube).all()
    assert (cube == repeated_cube).all()
    assert abs(cube - ideal_cube).max() > 0
    # Noise impairments state their power: mean of n exponential powers, five standard errors.
    expected_w = impairment.noise_power_w(scene, radar)
    if expected_w:
        added_w = float(np.mean(abs(cube - ideal_cube) ** 2))
        assert added_w == pytest.approx(expected_w, rel=5 * np.sqrt(2 / cube.size))


@pytest.mark.parametrize("kind", Multiplexing.members())
def test_target_is_detected_under_each_multiplexing(radar, kind):
    multiplexing = build_example(Multiplexing.members()[kind])
    # Centred on the origin, the reference of ranges; the spacing has grating lobes.
    middle = (multiplexing.n_tx - 1) / 2
    array = dc.Array(tx_m=[(0, 0.0078 * (k - middle), 0) for k in range(multiplexing.n_tx)])
    frame = replace(radar.frame, multiplexing=multiplexing)
    radar = replace(radar, frame=frame, array=array)
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(-5, 0, 0))
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    assert detections.sizes["detection"] == 1
    for name in ("range", "velocity"):
        assert (
            abs(detections[name].item() - truth[name].item()) < 5 * detections[f"{name}_std"].item()
        )
    # The noise estimate uses 320 cells that a Hann window correlates: 0.3 dB.
    assert 10 * np.log10(detections.snr.item() / truth.snr.item()) == pytest.approx(0, abs=1.5)


@pytest.mark.parametrize("velocity", [-5.0, 20.0])
@pytest.mark.parametrize("kind", Modulation.members())
def test_target_is_detected_under_each_modulation(radar, kind, velocity):
    frame = replace(radar.frame, modulation=build_example(Modulation.members()[kind]))
    radar = replace(radar, frame=frame)
    assert len(frame.ramps) == frame.n_slots > 1
    # 20 m/s exceeds the unambiguous velocity of one ramp sequence.
    assert radar.frame.max_velocity_m_per_s < 20
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(velocity, 0, 0))
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    assert detections.sizes["detection"] == 1
    for name in ("range", "velocity"):
        assert (
            abs(detections[name].item() - truth[name].item()) < 5 * detections[f"{name}_std"].item()
        )
    assert detections.ambiguity_confidence.item() > 0.99
    # As for multiplexing; at 20 m/s the target migrates by a third of a range cell.
    assert 10 * np.log10(detections.snr.item() / truth.snr.item()) == pytest.approx(0, abs=2)


@pytest.mark.parametrize("kind", Pattern.members())
def test_pattern_gain_is_bounded_by_its_peak_in_all_directions(kind):
    pattern = build_example(Pattern.members()[kind])
    azimuth, elevation = np.linspace(-np.pi, np.pi, 361), np.linspace(-np.pi / 2, np.pi / 2, 181)
    gain = pattern.gain_towards(azimuth, elevation[:, None])

    assert gain.shape == (181, 361)
    assert np.all(gain >= 0)
    # The grid is at most 1 degree from the peak.
    assert gain.max() == pytest.approx(pattern.peak_gain, rel=0.01)
    turned = replace(pattern, beam_azimuth_rad=1.0, beam_elevation_rad=0.5)
    assert turned.gain_towards(1.0, 0.5) == pytest.approx(float(pattern.gain_towards(0, 0)))


@pytest.mark.parametrize("kind", Body.members())
def test_body_echo_equals_echoes_of_its_scatterers(radar, kind):
    body = build_example(Body.members()[kind])
    position_m, velocity = np.array([20.0, 2.0, -0.5]), (3, 0, 0)
    target = dc.Target(
        position_m=tuple(position_m), velocity_m_per_s=velocity, heading_rad=np.pi, body=body
    )
    wavelength_m = radar.frame.chirp.wavelength_m
    scene = dc.Scene(targets=[target])
    rcs_m2 = scatterer_cross_sections_m2(scene, radar.frame.mid_frame_s, wavelength_m)
    # The body faces the radar, so its x and y axes are reversed.
    offsets_m = body.scatterer_offsets_m(np.zeros(1))[0] * [-1, -1, 1]
    is_visible = rcs_m2 > 1e-12  # minimum RCS of a target
    scatterer_targets = [
        dc.Target(position_m=tuple(scatterer_m), velocity_m_per_s=velocity, rcs_m2=scatterer_rcs_m2)
        for scatterer_m, scatterer_rcs_m2 in zip(
            (position_m + offsets_m)[is_visible], rcs_m2[is_visible], strict=True
        )
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)  # behind the radar, or out of range
        frames = [
            dc.simulate(variant, radar, impairments=(), dtype=np.complex128)
            for variant in (scene, dc.Scene(targets=scatterer_targets))
        ]

    assert scatterer_targets and body.n_scatterers() == len(rcs_m2)
    assert body.scatterer_offsets_m(np.array([0.0, 0.1])).shape == (2, len(rcs_m2), 3)
    # Both are accurate to 1e-9 of the RMS echo; one omits the faintest scatterers.
    omitted_amplitude = np.sqrt(rcs_m2[~is_visible]).sum() / np.sqrt(rcs_m2.max())
    assert abs(frames[0] - frames[1]).max() < (1e-8 + 2 * omitted_amplitude) * abs(frames[0]).max()


@pytest.mark.parametrize("kind", Format.members())
def test_format_rejects_file_of_other_format(tmp_path, kind):
    reader = build_example(Format.members()[kind])
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8)
    assert reader.recognise(picture) == MatchQuality.NO
    with pytest.raises(dc.RecordingError):
        dc.open(picture, format=kind, axes=("chirp", "sample"))
