"""Slow-time mitigation: removal of static echoes, gain of moving ones, noise and false alarms."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.mitigation.leakage_subtraction import LeakageSubtraction
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.processing.mitigation.moving_target_indication import MovingTargetIndication
from dechirp.processing.mitigation.noise_loss import (
    equalise_map_noise,
    mitigation_noise_gain,
    sufficient_noise_gain_mask,
)
from dechirp.processing.spectrum import Transform, mean_range_doppler_power
from nightly import nightly, nightly_except
from noise_cubes import simulate_noise_cube

FILTERS = [MeanSubtraction(), *(MovingTargetIndication(order=n) for n in (1, 2, 3))]
NEAR_M = 6.0


def replace_chirp(radar, **fields):
    return replace(radar, frame=replace(radar.frame, chirp=replace(radar.frame.chirp, **fields)))


def simulate_echoes(radar, *targets):
    """Simulate one noise-free frame of targets, each (range, velocity)."""
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=10.0)
            for range_m, velocity in targets
        ]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)  # aliased velocities
        return dc.simulate(scene, radar, impairments=()).values[0]


def compute_mean_square(samples):
    return float(np.mean(np.abs(samples) ** 2))


def compute_gain_db(output_samples, input_samples):
    return 10 * np.log10(
        max(compute_mean_square(output_samples) / compute_mean_square(input_samples), 1e-30)
    )


# Targets


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("method", [*FILTERS, LeakageSubtraction(max_range_m=35.0)], ids=repr)
def test_static_targets_are_removed(radar, method, sampling):
    radar = replace_chirp(radar, sampling=sampling)
    static_samples = simulate_echoes(radar, (3.0, 0), (17.3, 0))

    # Samples have 24 bits: a residue of 1 / 128 of 1e-7 is -140 dB. Leakage subtraction: its
    # documentation gives -60 dB for six sequences more than the width of the band.
    max_residual_db = -60 if isinstance(method, LeakageSubtraction) else -120
    residual = method.clean(static_samples, radar.frame)
    taper = np.hanning(static_samples.shape[-1])
    assert compute_gain_db(residual * taper, static_samples * taper) < max_residual_db
    assert residual.dtype == (np.complex64 if sampling == "complex" else np.float32)


@pytest.mark.parametrize("method", FILTERS, ids=repr)
def test_moving_target_power_matches_doppler_gain(radar, method):
    frame = radar.frame
    doppler_hz = np.array([0.1, 0.44, 1.0, 7.3, 31.7, 64.0, 127.6, 130.2]) / frame.duration_s
    turns = np.exp(2j * np.pi * doppler_hz[:, None] * frame.chirp_starts_s)
    series = np.ones((frame.n_chirps_total, 1, frame.chirp.n_samples), np.complex64)
    order = getattr(method, "order", 0)  # the first chirps of a canceller are zeros
    powers = [
        compute_mean_square(method.clean(t[:, None, None] * series, frame)[order:]) for t in turns
    ]

    # Sums of 128 numbers in single precision.
    assert powers == pytest.approx(
        method.doppler_power_gain(doppler_hz, frame), rel=1e-4, abs=1e-10
    )
    assert MeanSubtraction().doppler_power_gain(np.zeros(2), frame).tolist() == [0, 0]


def test_canceller_weights_are_binomial_with_unit_norm(radar):
    for order, weights in ((1, [1, -1]), (2, [1, -2, 1]), (3, [1, -3, 3, -1])):
        pulse = np.zeros((radar.frame.n_chirps, 1))
        pulse[60] = 1
        response = MovingTargetIndication(order=order).filter_chirp_series(pulse)[:, 0]
        assert response[60 : 61 + order] == pytest.approx(weights / np.linalg.norm(weights))
        assert np.count_nonzero(response) == order + 1


@pytest.mark.parametrize("method", FILTERS, ids=repr)
def test_finding_gives_velocity_of_3_db_loss(radar, method):
    (finding,) = method.limitation_findings(radar)
    edge_velocity = float(finding.value.split("less than ")[1].split(" m/s")[0])
    blind_velocity = float(finding.value.split("multiples of ")[1].split(" m/s")[0])

    assert blind_velocity == pytest.approx(2 * radar.frame.max_velocity_m_per_s, rel=1e-3)
    assert finding.level == ("warning" if method == MovingTargetIndication(order=3) else "note")
    # 0.427 cells (1 - 2 C D + C^2 of both kernels), or the velocity at which (2 sin)^2n is half
    # of its mean.
    if isinstance(method, MeanSubtraction):
        assert edge_velocity == pytest.approx(
            0.427 * radar.frame.velocity_resolution_m_per_s, rel=0.02
        )
    else:
        share = {1: 1 / 6, 2: 0.2286, 3: 0.2625}[method.order]
        assert edge_velocity == pytest.approx(
            2 * share * radar.frame.max_velocity_m_per_s, rel=0.01
        )
    for velocity, is_attenuated in (
        (0.97 * edge_velocity, True),
        (1.03 * edge_velocity, False),
        (blind_velocity + edge_velocity / 2, True),
    ):
        moving_samples = simulate_echoes(radar, (20.0, velocity))
        order = getattr(method, "order", 0)
        loss_db = -compute_gain_db(
            method.clean(moving_samples, radar.frame)[order:], moving_samples[order:]
        )
        assert (loss_db > 3.01) == is_attenuated


@pytest.mark.parametrize("method", FILTERS, ids=repr)
@pytest.mark.parametrize(
    "multiplexing",
    [
        dc.multiplexing.Tdm(order=(0, 1)),
        dc.multiplexing.Bpm(order=(0, 1)),
        dc.multiplexing.Ddma(order=(0, 1), n_sub_bands=4),
    ],
    ids=lambda multiplexing: multiplexing.kind(),
)
def test_each_slot_is_filtered_separately(radar, method, multiplexing):
    frame = replace(radar.frame, n_chirps=32, multiplexing=multiplexing)
    array = dc.Array(tx_m=[(0, 0, 0), (0, 5e-3, 0)], rx_m=[(0, 0, 0)])
    radar = replace(radar, frame=frame, array=array)
    static_samples, moving_samples = (
        simulate_echoes(radar, (17.3, 0)),
        simulate_echoes(radar, (17.3, 4.0)),
    )

    assert compute_gain_db(method.clean(static_samples, frame), static_samples) < -110
    doppler_hz = 2 * 4.0 / frame.chirp.wavelength_m
    residual = method.clean(moving_samples, frame)[getattr(method, "order", 0) * frame.n_slots :]
    passed_db = 10 * np.log10(float(method.doppler_power_gain(doppler_hz, frame)))
    # Range walk of a hundredth of a cell; the Doppler frequency varies by 1 % over the sweep.
    assert compute_gain_db(residual, moving_samples) == pytest.approx(passed_db, abs=0.1)


def test_leakage_subtraction_removes_static_echoes_below_max_range_only(radar):
    method, frame = LeakageSubtraction(max_range_m=NEAR_M), radar.frame
    cell_m = frame.chirp.range_resolution_m
    taper = np.hanning(frame.chirp.n_samples)

    def measure_gain_db(samples):
        return compute_gain_db(method.clean(samples, frame) * taper, samples * taper)

    for near_m in (0.2, 1.0, 3.1, NEAR_M - 1.1 * cell_m):
        assert measure_gain_db(simulate_echoes(radar, (near_m, 0))) < -50
    for far_m in (NEAR_M + 3.1 * cell_m, 11.3, 40.0, 70.0):
        assert abs(measure_gain_db(simulate_echoes(radar, (far_m, 0)))) < 0.1
    # A moving target near the radar is attenuated as by mean subtraction.
    moving_samples = simulate_echoes(radar, (3.0, 10.0))
    assert measure_gain_db(moving_samples) == pytest.approx(
        compute_gain_db(MeanSubtraction().clean(moving_samples, frame), moving_samples), abs=0.01
    )
    assert method.doppler_power_gain(np.zeros(3), frame).tolist() == [1, 1, 1]
    assert f"nearer than {NEAR_M:.4g} m" in method.limitation_findings(radar)[0].value


def test_falling_ramps_lose_near_ranges_only(radar):
    frame = replace(radar.frame, n_chirps=32, modulation=dc.modulations.Triangular())
    radar, method = replace(radar, frame=frame), LeakageSubtraction(max_range_m=NEAR_M)
    near_samples, far_samples = simulate_echoes(radar, (2.0, 0)), simulate_echoes(radar, (30.0, 0))
    taper = np.hanning(frame.chirp.n_samples)
    for slot in (slice(0, None, 2), slice(1, None, 2)):
        assert (
            compute_gain_db(
                method.clean(near_samples, frame)[slot] * taper, near_samples[slot] * taper
            )
            < -50
        )
        assert abs(compute_gain_db(method.clean(far_samples, frame)[slot], far_samples[slot])) < 0.1


@pytest.mark.parametrize("method", [*FILTERS, LeakageSubtraction(max_range_m=40.0)], ids=repr)
def test_lost_chirps_stay_zero_and_leave_no_residue(radar, method):
    static_samples = simulate_echoes(radar, (3.0, 0), (17.3, 0))
    lost_chirps = [0, 17, 18, 90]
    static_samples[lost_chirps] = 0
    residual = method.clean(static_samples, radar.frame)
    taper = np.hanning(static_samples.shape[-1])

    assert not residual[lost_chirps].any()
    assert compute_gain_db(residual * taper, static_samples * taper) < -60


# Noise


@pytest.mark.parametrize("window", nightly_except(1, ["hann", "rectangular", "blackman-harris"]))
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(
    "methods",
    [
        (MeanSubtraction(),),
        (MovingTargetIndication(order=2),),
        (LeakageSubtraction(max_range_m=20.0),),
        (MovingTargetIndication(order=1), LeakageSubtraction(max_range_m=10.0)),
        (MeanSubtraction(), MeanSubtraction()),
    ],
    ids=lambda methods: "+".join(method.kind() for method in methods),
)
def test_noise_power_matches_predicted_noise_gain(radar, methods, sampling, window):
    radar = shrink_radar(replace_chirp(radar, sampling=sampling))
    axis_transforms = build_transforms(radar, window, 40)
    noise_gain = mitigation_noise_gain(methods, radar.frame.chirp, *axis_transforms)
    rng = np.random.default_rng(81)
    n_frames, total = 400, 0
    for _ in range(n_frames):
        total = total + simulate_noise_map(radar, rng, methods, axis_transforms) / unit_noise_power(
            radar, axis_transforms
        )
    mean = total / n_frames

    assert noise_gain.shape == mean.shape and noise_gain.dtype == np.float32
    rows = slice(3, -3) if sampling == "real" else slice(None)  # noise about DC is not circular
    # Each cell is a mean of 400 exponential powers over the noise power without mitigation.
    n_cells = mean[:, rows].size
    assert np.all(
        abs(mean - noise_gain)[:, rows] < 6 / np.sqrt(n_frames) * noise_gain[:, rows] + 1e-6
    )
    # Mean over all cells: five standard errors; windows correlate 2.5 cells along each axis.
    ratio = float(np.mean(mean[:, rows])) / float(np.mean(noise_gain[:, rows]))
    assert ratio == pytest.approx(1, abs=5 * 2.5 / np.sqrt(n_frames * n_cells))


def shrink_radar(radar):
    """Reduce the radar to one receiver and 32 chirps of 64 samples, for speed."""
    array = dc.Array(rx_m=[(0, 0, 0)])
    frame = replace(radar.frame, n_chirps=32, chirp=replace(radar.frame.chirp, n_samples=64))
    return replace(radar, frame=frame, array=array)


def build_transforms(radar, window, n_velocity_bins):
    chirp, frame = radar.frame.chirp, radar.frame
    return (
        Transform(window="hann", n_points=chirp.n_samples, n_bins=chirp.n_samples),
        Transform(window=window, n_points=frame.n_chirps, n_bins=n_velocity_bins),
    )


def simulate_noise_map(radar, rng, methods, axis_transforms):
    samples = simulate_noise_cube(radar, rng).values[0]
    for method in methods:
        samples = method.clean(samples, radar.frame)
    return mean_range_doppler_power(samples, radar.frame.chirp.sampling, *axis_transforms)


def unit_noise_power(radar, axis_transforms):
    """Compute the noise power of a cell for unit noise in the samples, without mitigation."""
    chains = [
        np.sum(transform.weights**2) / np.sum(transform.weights) ** 2
        for transform in axis_transforms
    ]
    return chains[0] * chains[1] * (1 if radar.frame.chirp.sampling == "complex" else 2)


@nightly
@pytest.mark.parametrize(
    "method",
    [MeanSubtraction(), MovingTargetIndication(order=2)],
    ids=lambda m: m.kind(),
)
def test_false_alarm_rate_matches_setting_after_mitigation(radar, method):
    radar = replace(
        radar,
        frame=replace(radar.frame, n_chirps=64, chirp=replace(radar.frame.chirp, n_samples=128)),
        array=dc.Array(rx_m=[(0, 0, 0)]),
    )
    chain = dc.Chain(cfar=dc.Cfar(estimator=dc.cfar.CellAveraging(), false_alarm_probability=1e-4))
    noise = chain.map_noise_statistics(radar)
    axis_transforms = noise.range_transform, noise.doppler_transform
    noise_gain = mitigation_noise_gain((method,), radar.frame.chirp, *axis_transforms)
    is_searched = sufficient_noise_gain_mask(noise_gain)
    rng = np.random.default_rng(82)
    n_frames, n_alarms, n_plain_alarms = 2500, np.zeros(noise_gain.shape), 0
    for _ in range(n_frames):
        power = simulate_noise_map(radar, rng, (method,), axis_transforms)
        n_plain_alarms += np.count_nonzero(chain.cfar.exceeds_threshold(power, noise) & is_searched)
        n_alarms += (
            chain.cfar.exceeds_threshold(equalise_map_noise(power, noise_gain), noise) & is_searched
        )
    rates = n_alarms.sum(axis=1) / (n_frames * np.maximum(is_searched.sum(axis=1), 1) * 1e-4)

    # 1,400 alarms or more in clusters of at most 1.9: a standard error of 3.7 %; in the rows whose
    # training windows cross the notch, 12 on each side, 5 %.
    searched_rows = is_searched.any(axis=1)
    assert rates[searched_rows].mean() == pytest.approx(1, abs=0.2)
    row_distance = np.abs(np.arange(64) - 32)
    is_near_notch = searched_rows & (row_distance < row_distance[searched_rows].min() + 12)
    assert 0.75 < rates[is_near_notch].mean() < 1.3
    # Without equalisation the slopes of the wider notch raise the rate of alarms.
    if isinstance(method, MovingTargetIndication):
        assert n_plain_alarms / n_frames / np.count_nonzero(is_searched) / 1e-4 > 2


def test_rows_below_a_tenth_of_noise_are_not_searched(radar):
    axis_transforms = build_transforms(radar, "hann", radar.frame.n_chirps)
    noise_gain = mitigation_noise_gain((MeanSubtraction(),), radar.frame.chirp, *axis_transforms)
    middle = radar.frame.n_chirps // 2

    # Removing the mean under a Hann taper removes the whole row at zero velocity.
    assert np.flatnonzero(~sufficient_noise_gain_mask(noise_gain).any(axis=1)).tolist() == [middle]
    # Adjacent rows lose half of that mean: 1 + 1 / 4 - 2 / 3, the correlation of neighbours.
    assert noise_gain[middle + 1] == pytest.approx(7 / 12, abs=2e-3)
    power = np.ones(noise_gain.shape, np.float32) * noise_gain
    power[middle] = 1e6  # rounding errors over zero noise
    assert equalise_map_noise(power, noise_gain) == pytest.approx(np.ones(noise_gain.shape))
    # A rectangular window keeps noise at zero velocity: 1 - 2 + 1.5.
    rectangular_transforms = build_transforms(radar, "rectangular", 128)
    rectangular_gain = mitigation_noise_gain(
        (MeanSubtraction(),), radar.frame.chirp, *rectangular_transforms
    )
    assert rectangular_gain[middle] == pytest.approx(1 / 2, abs=1e-6)
    assert rectangular_gain[middle + 1] == pytest.approx(1, abs=1e-6)


def test_noise_gain_without_filters_is_one(radar):
    axis_transforms = build_transforms(radar, "hann", radar.frame.n_chirps)
    assert np.all(mitigation_noise_gain((), radar.frame.chirp, *axis_transforms) == 1)


# Wrong input


@pytest.mark.parametrize("method", [*FILTERS, LeakageSubtraction(max_range_m=NEAR_M)], ids=repr)
def test_rejects_samples_that_do_not_fit_frame(radar, method):
    frame = radar.frame
    samples = np.ones((frame.n_chirps_total, 2, frame.chirp.n_samples), np.complex64)
    for invalid_samples, message in (
        (samples[:-1], "127"),
        (samples[:, :, 1:], "255"),
        (samples[0], "shape"),
        (samples.real, "float32"),
        (np.where(np.arange(2)[:, None] == 0, samples, np.nan), "finite"),
    ):
        with pytest.raises(dc.InvalidSetting, match=message):
            method.clean(invalid_samples, frame)
    short_radar = replace(radar, frame=replace(frame, n_chirps=1))
    with pytest.raises(dc.InvalidSetting, match=method.kind()):
        method.limitation_findings(short_radar)
    input_samples = samples.copy()
    method.clean(input_samples, frame)
    assert (input_samples == samples).all()


def test_rejects_invalid_settings(radar):
    for order in (0, 4, 1.5):
        with pytest.raises(dc.InvalidSetting, match="order"):
            MovingTargetIndication(order=order)
    for max_range_m in (0, -1, float("nan")):
        with pytest.raises(dc.InvalidSetting, match="max_range_m"):
            LeakageSubtraction(max_range_m=max_range_m)
    with pytest.raises(dc.InvalidSetting, match="mean-subtraction"):
        LeakageSubtraction(max_range_m=radar.frame.chirp.max_range_m).limitation_findings(radar)
