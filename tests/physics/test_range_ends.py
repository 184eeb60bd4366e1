"""Moving echoes of real samples at both ends of the range axis, beside their mirror images."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

import dechirp as dc
from dechirp.processing.hidden_echoes import velocity_sign_findings
from dechirp.processing.peaks import find_peaks
from dechirp.processing.range_doppler_map import detect_peaks_and_count_dropped
from nightly import nightly, nightly_except

CHIRP = dc.Chirp(
    start_frequency_hz=77e9, slope_hz_per_s=20e12, adc_start_s=3e-6, ramp_duration_s=18e-6,
    sample_rate_hz=20e6, n_samples=256, sampling="real",
)  # fmt: skip
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=64, interval_s=25e-6),
    array=dc.Array(rx_m=[(0, 1.95e-3 * k, 0) for k in range(4)]),
    hardware=dc.Hardware(transmit_power_w=1e-3, antenna_gain=1.0, noise_factor=10.0),
)
CELL_M = CHIRP.range_resolution_m
VELOCITY_CELL = RADAR.frame.velocity_resolution_m_per_s


def make_scene(range_cells, velocity_cells, *, azimuth=0.0, snr_db=40.0):
    """Return a scene with a target of this SNR after integration; units of range and velocity."""
    direction = np.array([np.cos(azimuth), np.sin(azimuth), 0])
    target = dc.Target(
        position_m=tuple(range_cells * CELL_M * direction),
        velocity_m_per_s=tuple(velocity_cells * VELOCITY_CELL * direction),
        rcs_m2=1.0,
    )
    snr = dc.truth(dc.Scene(targets=[target]), RADAR).snr.item()
    return dc.Scene(targets=[replace(target, rcs_m2=10 ** (snr_db / 10) / snr)])


# Cells nearer than half a cell are not searched; coupling shifts echoes by 0.24 cells at most.
@nightly
@pytest.mark.parametrize(("first_cell", "last_cell"), [(0.8, 1.6), (126.4, 127.75)])
def test_moving_echo_at_range_end_is_found_once_with_stated_errors(first_cell, last_cell):
    rng, n_trials = np.random.default_rng(3), 120
    squared = []
    n_others = 0
    for trial in range(n_trials):
        scene = make_scene(
            rng.uniform(first_cell, last_cell),
            rng.choice([-1, 1]) * rng.uniform(2.5, 29.5),
            azimuth=rng.uniform(-0.8, 0.8),
            snr_db=rng.uniform(22, 45),
        )
        found = dc.detect(dc.simulate(scene, RADAR, seed=trial), RADAR)
        truth = dc.truth(scene, RADAR)
        is_target = abs(found.range.values - truth.range.item()) < CELL_M
        is_target &= abs(found.velocity.values - truth.velocity.item()) < VELOCITY_CELL
        assert is_target.sum() == 1
        n_others += len(is_target) - 1
        squared.append(
            [
                ((found[name].values - truth[name].item()) / found[f"{name}_std"].values)[
                    is_target
                ].item()
                ** 2
                for name in ("range", "velocity", "azimuth")
            ]
        )
    # 120 maps have one false alarm in the mean: more than 10 with a probability of 1e-8.
    assert n_others <= 10
    # Six sums are compared: 1e-7 each.
    low, high = scipy.stats.chi2.ppf([1e-7, 1 - 1e-7], n_trials) / n_trials
    assert np.all((low < np.mean(squared, axis=0)) & (np.mean(squared, axis=0) < high))


@pytest.mark.parametrize("velocity_cells", nightly_except(1, [0.0, 0.4, 1.0, 1.6, 8.3, 31.9]))
@pytest.mark.parametrize(
    "range_cells", nightly_except(4, [0.2, 0.6, 0.8, 1.0, 1.4, 3.3, 125.3, 126.6, 127.1, 127.7])
)
def test_strong_echo_at_range_end_has_no_false_detections(range_cells, velocity_cells):
    scene = make_scene(range_cells, velocity_cells, snr_db=90)
    truth = dc.truth(scene, RADAR)
    for seed in range(3):
        found = dc.detect(dc.simulate(scene, RADAR, seed=seed), RADAR)
        is_target = abs(found.range.values - truth.range.item()) < 0.3 * CELL_M
        is_target &= abs(found.velocity.values - truth.velocity.item()) < 0.3 * VELOCITY_CELL
        assert np.count_nonzero(~is_target & (found.snr.values > 100)) == 0
        assert is_target.sum() <= 1


# The image of the strong echo is 80 or 11 cells away, at the velocity of the weak one: without a
# window, its sidelobes are 20 and 4 dB above the noise, or 30 dB. At 20.34 velocity cells it walks
# by 0.07 range cells, which shifts its frequency within the blocks of 16 samples that are summed:
# their response to it has a null only without the walk.
@pytest.mark.parametrize(
    ("weak_cells", "weak_snr_db", "strong_cells", "strong_snr_db", "velocity_cells"),
    nightly_except(
        [(108.95, 32, 66.84, 85, 20.34)],
        [
            (108.95, 32, 66.84, 75, 4.34),
            (6.0, 25, 5.2, 35, 5.3),
            (108.95, 32, 66.84, 85, 20.34),
            (125.0, 32, 66.84, 85, 20.34),
        ],
    ),
)
def test_image_of_strong_echo_leaves_stated_errors(
    weak_cells, weak_snr_db, strong_cells, strong_snr_db, velocity_cells
):
    weak = make_scene(weak_cells, -velocity_cells, azimuth=-0.5, snr_db=weak_snr_db)
    strong = make_scene(strong_cells, velocity_cells, azimuth=0.5, snr_db=strong_snr_db)
    assert_stated_errors(weak, strong, RADAR)


# 80 and 48 range cells apart, at one velocity and azimuth.
@nightly
@pytest.mark.parametrize(
    ("weak_cells", "strong_cells"),
    [(108.95, 28.74), (112.2, 32.2), (108.95, 60.7)],
)
def test_strong_echo_that_walks_leaves_stated_errors(weak_cells, strong_cells):
    weak = make_scene(weak_cells, 20.34, azimuth=-0.5, snr_db=32)
    strong = make_scene(strong_cells, 20.34, azimuth=-0.5, snr_db=85)
    complex_chirp = replace(CHIRP, sampling="complex")
    assert_stated_errors(
        weak, strong, replace(RADAR, frame=replace(RADAR.frame, chirp=complex_chirp))
    )


# Its delay differs by 0.009 cells over eight receivers, which left five times the stated variance.
@nightly
def test_strong_echo_far_from_boresight_leaves_stated_errors():
    rx_m = [(0, 1.95e-3 * k, 0) for k in range(8)]
    frame = replace(RADAR.frame, chirp=replace(CHIRP, sampling="complex"))
    weak = make_scene(108.95, 4.34, azimuth=-0.9, snr_db=29)
    strong = make_scene(60.95, 4.34, azimuth=-0.9, snr_db=87)
    assert_stated_errors(weak, strong, replace(RADAR, frame=frame, array=dc.Array(rx_m=rx_m)))


def assert_stated_errors(weak, strong, radar):
    """Compare the errors of a weak echo beside a strong one with the stated ones, in 60 trials."""
    n_trials = 60
    scene = dc.Scene(targets=[*weak.targets, *strong.targets])
    truth = dc.truth(weak, radar)
    squared = []
    for seed in range(n_trials):
        found = dc.detect(dc.simulate(scene, radar, seed=seed), radar)
        is_weak = abs(found.range.values - truth.range.item()) < CELL_M
        is_weak &= abs(found.velocity.values - truth.velocity.item()) < VELOCITY_CELL
        (weakest,) = np.flatnonzero(is_weak)
        row = found.isel(detection=weakest)
        squared.append(
            [
                ((row[name].item() - truth[name].item()) / row[f"{name}_std"].item()) ** 2
                for name in ("range", "velocity", "azimuth")
            ]
        )
    mean = np.mean(squared, axis=0)
    # Six sums are compared: 1e-7 each.
    low, high = scipy.stats.chi2.ppf([1e-7, 1 - 1e-7], n_trials) / n_trials
    assert np.all((low < mean) & (mean < high)), mean


@pytest.mark.parametrize("offset_db", [20, 40, 60])
@pytest.mark.parametrize("range_cells", [2.6, 3.4, 4.3, 6.2])
def test_offset_of_the_converter_hides_no_echo_at_rest(range_cells, offset_db):
    cube = dc.simulate(make_scene(range_cells, 0.0, snr_db=35), RADAR, seed=1)
    amplitude = np.sqrt(dc.power_map(cube, RADAR).values.max())

    found = dc.detect(cube + np.float32(amplitude * 10 ** (offset_db / 20)), RADAR)

    errors_m = abs(found.range.values - range_cells * CELL_M)
    assert np.count_nonzero(errors_m < np.minimum(5 * found.range_std.values, CELL_M / 2)) == 1


@pytest.mark.parametrize(
    ("range_cells", "has_unknown_sign"),
    [(1.0, False), (127.97, True), (127.5, False)],
)
def test_velocity_of_unknown_sign_is_named(range_cells, has_unknown_sign):
    scene = make_scene(range_cells, 8.3, snr_db=25)
    found = dc.detect(dc.simulate(scene, RADAR, seed=1), RADAR)

    findings = velocity_sign_findings(found, RADAR)

    assert abs(found.velocity.values[0]) == pytest.approx(8.3 * VELOCITY_CELL, abs=VELOCITY_CELL)
    assert len(findings) == has_unknown_sign
    if has_unknown_sign:
        assert f"at {abs(found.velocity.values[0]):.3g} or" in findings[0].value.replace("-", "")


@nightly
def test_peaks_at_range_ends_exceed_the_threshold_map():
    chain = dc.Chain(cfar=replace(dc.Chain.cfar, false_alarm_probability=1e-2)).fit_to_radar(RADAR)
    n_at_ends = 0
    for seed in range(3):
        cube = dc.simulate(dc.Scene(), RADAR, seed=seed)
        power = dc.power_map(cube, RADAR, chain)
        threshold = dc.threshold_map(power, RADAR, chain)
        cells, _ = detect_peaks_and_count_dropped(power.values, RADAR, chain)
        expected = find_peaks(power.values, threshold.values, chain.map_noise_statistics(RADAR))
        at_ends = {(v, r) for v, r in cells.tolist() if not 2 <= r <= 126}
        # Peaks in cells that are not searched have sidelobes, and hide others.
        assert at_ends <= set(map(tuple, expected.tolist()))
        n_at_ends += len(at_ends)
    assert n_at_ends > 0


# Intervals of 8 us: velocities between one and two spans of a round of two transmitters, 61 and
# 122 m/s, shift echoes by up to 0.19 cells, and so those up to 0.19 cells from the end beyond it.
@pytest.mark.parametrize("velocity_m_per_s", [-115.0, -85.0, 85.0, 115.0])
@pytest.mark.parametrize("range_cells", [31.75, 31.9])
def test_range_of_resolved_velocity_is_within_range_axis(range_cells, velocity_m_per_s):
    half_wavelength_m = 1.945e-3
    chirp = replace(CHIRP, ramp_duration_s=8e-6, n_samples=64)
    radar = dc.Radar(
        frame=dc.Frame(
            chirp=chirp,
            n_chirps=48,
            interval_s=8e-6,
            multiplexing=dc.multiplexing.Tdm(order=[0, 1]),
        ),
        array=dc.Array(
            tx_m=[(0, 4 * k * half_wavelength_m, 0) for k in range(2)],
            rx_m=[(0, k * half_wavelength_m, 0) for k in range(4)],
        ),
        hardware=RADAR.hardware,
    )
    direction = np.array([np.cos(0.3), np.sin(0.3), 0])
    target = dc.Target(
        position_m=tuple(range_cells * chirp.range_resolution_m * direction),
        velocity_m_per_s=tuple(velocity_m_per_s * direction),
        rcs_m2=1.0,
    )
    snr = dc.truth(dc.Scene(targets=[target]), radar).snr.item()
    scene = dc.Scene(targets=[replace(target, rcs_m2=1e4 / snr)])

    with pytest.warns(dc.PhysicsWarning, match="is aliased"):  # within one span
        cube = dc.simulate(scene, radar, seed=1)
    found = dc.detect(cube, radar)

    assert found.sizes["detection"] == 1
    truth = dc.truth(scene, radar)
    for name in ("range", "velocity", "azimuth"):
        # Six standard errors: by chance once in 5e8.
        assert abs(found[name].item() - truth[name].item()) < 6 * found[f"{name}_std"].item()
    assert np.sign(found.ambiguity_number.item()) == np.sign(velocity_m_per_s)


# Intervals in turn: of 34 us, velocities beyond 28.6 m/s are aliased, and coupling shifts the range
# of the third frame from 127.9 to 128.1 cells, beyond the end of the axis.
@pytest.mark.parametrize(
    ("range_cells", "velocity_m_per_s"),
    [(127.65, 31.0), (127.45, 62.0), (127.75, -31.0), (127.85, -62.0)],
)
def test_velocity_at_range_end_is_resolved_by_frame_intervals(range_cells, velocity_m_per_s):
    radar = replace(RADAR, frame=replace(RADAR.frame, interval_s=(25e-6, 29e-6, 34e-6)))
    scene = make_scene(range_cells, velocity_m_per_s / VELOCITY_CELL, snr_db=38)

    with pytest.warns(dc.PhysicsWarning, match="is aliased"):  # within one span
        cube = dc.simulate(scene, radar, n_frames=3, seed=1)
    found = dc.detect(cube, radar)

    assert found["frame"].values.tolist() == [0, 1, 2]
    truth = dc.truth(scene, radar, n_frames=3).isel(target=0)
    for name in ("range", "velocity", "azimuth"):
        # Six standard errors: by chance once in 5e8.
        errors = abs(found[name].values - truth[name].values)
        assert np.all(errors < 6 * found[f"{name}_std"].values)
