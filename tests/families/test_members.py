"""The contract of each family, on every member it has."""

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
# Of three transmitters; the phases turn the second and the third by thirds of a circle.
GIVEN = {
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

# Members whose defaults do nothing, or whose settings others have with other meanings.
SETTINGS = {
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


def example(member):
    """The member with its defaults, and what is given or 1 where it has none."""
    needed = [f.name for f in fields(member) if f.default is MISSING]
    settings = {name: GIVEN.get(name, 1.0) for name in needed}
    return member(**{**settings, **SETTINGS.get(member.kind(), {})})


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.group)
def test_kind_of_member_is_its_class_name_with_hyphens(family):
    members = family.members()
    assert members
    for kind, member in members.items():
        assert kind.replace("-", "") == member.__name__.lower()
        assert isinstance(example(member), family)


def test_another_package_adds_a_member_by_an_entry_point(tmp_path):
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
    # In a process of its own, which takes the guest with it.
    path = os.pathsep.join([str(tmp_path), str(Path(dc.__file__).parent.parent)])
    code = (
        "from dechirp.config.loading import parse_settings; from dechirp.processing.cfar.base"
        " import Cfar;"
        "print(parse_settings('estimator: {kind: always-three}\\noffset: 3 dB', Cfar).estimator)"
    )
    found = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == "AlwaysThree()"


@pytest.mark.parametrize("kind", NoiseEstimator.members())
@pytest.mark.parametrize("where", ["middle", "first rows", "last rows"])
def test_each_cfar_alarms_as_asked_in_white_noise(radar, kind, where):
    estimator = example(NoiseEstimator.members()[kind])
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
    for _ in range(60):
        power = dc.power_map(simulate_noise_cube(radar, rng).isel(frame=0), radar, chain)
        alarms = (power > dc.threshold_map(power, radar, chain)).values[:, rows[where]]
        hits, trials = hits + alarms.sum(), trials + alarms.size
    # Independent cells; their thresholds share training cells, which widens the spread by
    # less than 1.5: 537 alarms or more, five standard errors.
    spread = 1.5 * np.sqrt(1e-2 / trials)
    assert hits / trials == pytest.approx(1e-2, abs=5 * spread)


def on_line(n):
    """Elements half a wavelength apart, to the left of each other."""
    return Aperture(np.stack([np.zeros(n), np.arange(n) / 2, np.zeros(n)], axis=1))


def snapshots_of(azimuth, seen, rng):
    """One look each at a source of 20 dB in an element, with noise of unit power."""
    shape = (len(azimuth), 1, seen.n_elements)
    phase = np.exp(2j * np.pi * rng.uniform(size=(len(azimuth), 1)))
    noise = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    return (10 * phase * seen.steering_vectors(azimuth))[:, None] + noise / np.sqrt(2)


@pytest.mark.parametrize("n_elements", [4, 8])
@pytest.mark.parametrize("kind", DirectionEstimator.members())
def test_each_direction_estimator_finds_one_source_with_the_errors_it_states(kind, n_elements):
    estimator, seen, n = example(DirectionEstimator.members()[kind]), on_line(n_elements), 2000
    rng = np.random.default_rng(63)
    azimuth = rng.uniform(-0.8, 0.8, n)
    snapshots = snapshots_of(azimuth, seen, rng).astype(np.complex64)
    found = estimator.find_directions(snapshots, seen, np.ones(n))

    error = (found.azimuth_rad[:, 0] - azimuth) / found.azimuth_std_rad[:, 0]
    # Of 2,000 squared normal errors the mean has a standard error of 0.032.
    assert np.mean(error**2) == pytest.approx(1, abs=0.16)
    assert np.isnan(found.elevation_rad).all() and np.isnan(found.elevation_std_rad).all()
    # 20 dB, of which noise moves the mean by 0.01 dB.
    assert 10 * np.log10(np.mean(found.power[:, 0])) == pytest.approx(20, abs=0.1)


@pytest.mark.parametrize("kind", DirectionEstimator.members())
def test_each_direction_estimator_takes_a_snapshot_for_what_it_is(kind):
    """Whatever stands beside it, in whatever unit, and whenever the phase began."""
    estimator, seen = example(DirectionEstimator.members()[kind]), on_line(6)
    rng = np.random.default_rng(64)
    snapshots = snapshots_of(rng.uniform(-0.8, 0.8, 8), seen, rng)
    found = estimator.find_directions(snapshots, seen, np.ones(8))

    one = estimator.find_directions(snapshots[3:4], seen, np.ones(1))
    scaled = estimator.find_directions(snapshots * 1e-6j, seen, np.full(8, 1e-12))
    lost = snapshots.copy()
    lost[[1, 5]] = np.array([np.nan, 0])[:, None, None]
    holed = estimator.find_directions(lost, seen, np.ones(8))
    # A hundredth of a standard error.
    close = 0.01 * np.nanmin(found.azimuth_std_rad)
    assert one.azimuth_rad[0, 0] == pytest.approx(found.azimuth_rad[3, 0], abs=close)
    assert scaled.azimuth_rad == pytest.approx(found.azimuth_rad, abs=close)
    assert scaled.azimuth_std_rad == pytest.approx(found.azimuth_std_rad, rel=0.02)
    assert scaled.power == pytest.approx(1e-12 * found.power, rel=1e-3, abs=0)
    assert all(np.isnan(part[[1, 5]]).all() for part in holed)
    assert holed.azimuth_rad[[0, 7]] == pytest.approx(found.azimuth_rad[[0, 7]], abs=close)
    assert len(estimator.find_directions(snapshots[:0], seen, np.ones(0)).power) == 0


@pytest.mark.parametrize("kind", DirectionEstimator.members())
def test_each_direction_estimator_gives_two_sources_strongest_first_or_refuses_two(kind):
    member, seen = DirectionEstimator.members()[kind], on_line(12)
    try:
        estimator = member(n_sources=2)
    except dc.InvalidSetting as error:
        assert "n_sources" in str(error)
        return
    at, rng = np.array([-0.4, 0.5]), np.random.default_rng(65)
    amplitudes = np.array([10, 30]) * np.exp(2j * np.pi * rng.uniform(size=(50, 1, 2)))
    snapshots = amplitudes @ seen.steering_vectors(at)
    noise = rng.normal(size=snapshots.shape) + 1j * rng.normal(size=snapshots.shape)
    found = estimator.find_directions(snapshots + noise / np.sqrt(2), seen, np.ones(50))
    assert np.all(found.power[:, 0] > found.power[:, 1])
    # Those that smooth the array see beams wider, and sidelobes of the stronger source.
    assert np.all(abs(np.sin(found.azimuth_rad) - np.sin(at[::-1])) < 0.1 / 6)


@pytest.mark.parametrize("kind", DirectionEstimator.members())
def test_each_direction_estimator_refuses_what_it_cannot_answer(kind):
    member, seen = DirectionEstimator.members()[kind], on_line(3)
    with pytest.raises(dc.InvalidSetting, match="n_sources"):
        member(n_sources=3).find_directions(np.ones((1, 1, 3)), seen, np.ones(1))
    for wrong in (0, 1.5, "many"):
        with pytest.raises(dc.InvalidSetting, match="n_sources"):
            member(n_sources=wrong)
    estimator = example(member)
    with pytest.raises(dc.InvalidSetting, match="snapshots"):
        estimator.find_directions(np.ones((1, 1, 4)), seen, np.ones(1))
    for noise in (np.ones(2), np.array([np.nan]), np.array([-1.0])):
        with pytest.raises(dc.InvalidSetting, match="noise_power"):
            estimator.find_directions(np.ones((1, 1, 3)), seen, noise)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("kind", Impairment.members())
def test_each_impairment_changes_samples_alike_for_the_same_seed(radar, kind, sampling):
    impairment = example(Impairment.members()[kind])
    # Antennas apart, so that leakage has a way to go; 0.3 m above the ground.
    array = dc.Array(tx_m=[(0, 0.01, 0.3)], rx_m=[(0, 0, 0.3), (0, 0.002, 0.3)])
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, array=array, frame=replace(radar.frame, chirp=chirp))
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0.5))])
    if sampling == "real" and kind == "iq-imbalance":
        with pytest.raises(dc.InvalidSetting, match="real"):
            dc.simulate(scene, radar, impairments=[impairment])
        return
    clean = dc.simulate(scene, radar, impairments=(), n_frames=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)
        one, same = (
            dc.simulate(scene, radar, impairments=[impairment], n_frames=2, seed=62)
            for _ in range(2)
        )

    assert one.shape == clean.shape and one.dtype == clean.dtype
    assert np.isfinite(one).all()
    assert (one == same).all()
    assert abs(one - clean).max() > 0
    # What adds noise says how much: the mean of n exponential powers, five standard errors.
    expected_w = impairment.noise_power_w(scene, radar)
    if expected_w:
        added_w = float(np.mean(abs(one - clean) ** 2))
        assert added_w == pytest.approx(expected_w, rel=5 * np.sqrt(2 / one.size))


@pytest.mark.parametrize("kind", Multiplexing.members())
def test_under_each_multiplexing_a_target_is_found_by_all_transmitters_together(radar, kind):
    multiplexing = example(Multiplexing.members()[kind])
    # About the origin: directions are told by grating lobes here, and ranges are from there.
    middle = (multiplexing.n_tx - 1) / 2
    array = dc.Array(tx_m=[(0, 0.0078 * (k - middle), 0) for k in range(multiplexing.n_tx)])
    frame = replace(radar.frame, multiplexing=multiplexing)
    radar = replace(radar, frame=frame, array=array)
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(-5, 0, 0))
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    assert found.sizes["detection"] == 1
    for name in ("range", "velocity"):
        assert abs(found[name].item() - truth[name].item()) < 5 * found[f"{name}_std"].item()
    # The noise level comes from 320 cells that a Hann window correlates: 0.3 dB.
    assert 10 * np.log10(found.snr.item() / truth.snr.item()) == pytest.approx(0, abs=1.5)


@pytest.mark.parametrize("velocity", [-5.0, 20.0])
@pytest.mark.parametrize("kind", Modulation.members())
def test_under_each_modulation_a_target_is_found_where_it_is(radar, kind, velocity):
    frame = replace(radar.frame, modulation=example(Modulation.members()[kind]))
    radar = replace(radar, frame=frame)
    assert len(frame.ramps) == frame.n_slots > 1
    # Beyond what rounds alone tell without a fold.
    assert radar.frame.max_velocity_m_per_s < 20
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(velocity, 0, 0))
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    assert found.sizes["detection"] == 1
    for name in ("range", "velocity"):
        assert abs(found[name].item() - truth[name].item()) < 5 * found[f"{name}_std"].item()
    assert found.ambiguity_confidence.item() > 0.99
    # As for multiplexing; at 20 m/s it walks through a third of a range cell.
    assert 10 * np.log10(found.snr.item() / truth.snr.item()) == pytest.approx(0, abs=2)


@pytest.mark.parametrize("kind", Pattern.members())
def test_each_pattern_has_a_gain_for_all_directions_and_none_above_its_peak(kind):
    pattern = example(Pattern.members()[kind])
    azimuth, elevation = np.linspace(-np.pi, np.pi, 361), np.linspace(-np.pi / 2, np.pi / 2, 181)
    gain = pattern.gain_towards(azimuth, elevation[:, None])

    assert gain.shape == (181, 361)
    assert np.all(gain >= 0)
    # A degree from the peak at most.
    assert gain.max() == pytest.approx(pattern.peak_gain, rel=0.01)
    turned = replace(pattern, beam_azimuth_rad=1.0, beam_elevation_rad=0.5)
    assert turned.gain_towards(1.0, 0.5) == pytest.approx(float(pattern.gain_towards(0, 0)))


@pytest.mark.parametrize("kind", Body.members())
def test_the_scatterers_of_each_body_reflect_as_targets_of_their_own(radar, kind):
    body = example(Body.members()[kind])
    place_m, velocity = np.array([20.0, 2.0, -0.5]), (3, 0, 0)
    whole = dc.Target(
        position_m=tuple(place_m), velocity_m_per_s=velocity, heading_rad=np.pi, body=body
    )
    wavelength_m = radar.frame.chirp.wavelength_m
    scene = dc.Scene(targets=[whole])
    rcs_m2 = scatterer_cross_sections_m2(scene, radar.frame.mid_frame_s, wavelength_m)
    # It faces the radar: its x and y axes point the other way.
    offsets_m = body.offsets_m(np.zeros(1))[0] * [-1, -1, 1]
    seen = rcs_m2 > 1e-12  # the least that a target may have
    parts = [
        dc.Target(position_m=tuple(at_m), velocity_m_per_s=velocity, rcs_m2=one_m2)
        for at_m, one_m2 in zip((place_m + offsets_m)[seen], rcs_m2[seen], strict=True)
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)  # behind the radar, or out of range
        frames = [
            dc.simulate(each, radar, impairments=(), dtype=np.complex128)
            for each in (scene, dc.Scene(targets=parts))
        ]

    assert parts and body.n_scatterers() == len(rcs_m2)
    assert body.offsets_m(np.array([0.0, 0.1])).shape == (2, len(rcs_m2), 3)
    # Both are held to 1e-9 of the echo's root mean square; the faintest are left out of one.
    lost = np.sqrt(rcs_m2[~seen]).sum() / np.sqrt(rcs_m2.max())
    assert abs(frames[0] - frames[1]).max() < (1e-8 + 2 * lost) * abs(frames[0]).max()


@pytest.mark.parametrize("kind", Format.members())
def test_each_format_refuses_a_file_of_something_else(tmp_path, kind):
    member = example(Format.members()[kind])
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8)
    assert member.recognise(picture) == MatchQuality.NO
    with pytest.raises(dc.RecordingError):
        dc.open(picture, format=kind, axes=("chirp", "sample"))
