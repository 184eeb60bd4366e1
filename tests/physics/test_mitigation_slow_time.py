"""What stands still is taken out, what moves keeps what theory says, and noise stays lawful."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.mitigation.leakage_subtraction import LeakageSubtraction
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.processing.mitigation.moving_target_indication import MovingTargetIndication
from dechirp.processing.mitigation.noise_loss import equalise, mitigation_noise_gain, usable_cells
from dechirp.processing.spectrum import Transform, mean_power
from noise import noise_cube

FILTERS = [MeanSubtraction(), *(MovingTargetIndication(order=n) for n in (1, 2, 3))]
NEAR_M = 6.0


def with_chirp(radar, **fields):
    return replace(radar, frame=replace(radar.frame, chirp=replace(radar.frame.chirp, **fields)))


def echoes(radar, *targets):
    """Samples of one frame of targets, each (range, velocity), without noise."""
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=10.0)
            for range_m, velocity in targets
        ]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)  # that they fold
        return dc.simulate(scene, radar, impairments=()).values[0]


def mean_square(samples):
    return float(np.mean(np.abs(samples) ** 2))


def gain_db(after, before):
    return 10 * np.log10(max(mean_square(after) / mean_square(before), 1e-30))


# Targets


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("method", [*FILTERS, LeakageSubtraction(max_range_m=35.0)], ids=repr)
def test_what_stands_still_is_taken_out(radar, method, sampling):
    radar = with_chirp(radar, sampling=sampling)
    still = echoes(radar, (3.0, 0), (17.3, 0))

    # Samples have 24 bits: 1 / 128 of them left over in 1e7 is -140 dB; of the leakage method
    # -60 dB is what six sequences more than the band is wide are said to leave.
    least_db = -60 if isinstance(method, LeakageSubtraction) else -120
    left = method.clean(still, radar.frame)
    tapered = np.hanning(still.shape[-1])
    assert gain_db(left * tapered, still * tapered) < least_db
    assert left.dtype == (np.complex64 if sampling == "complex" else np.float32)


@pytest.mark.parametrize("method", FILTERS, ids=repr)
def test_a_moving_target_keeps_the_power_that_the_filter_passes(radar, method):
    frame = radar.frame
    doppler_hz = np.array([0.1, 0.44, 1.0, 7.3, 31.7, 64.0, 127.6, 130.2]) / frame.duration_s
    turns = np.exp(2j * np.pi * doppler_hz[:, None] * frame.chirp_starts_s)
    series = np.ones((frame.n_chirps_total, 1, frame.chirp.n_samples), np.complex64)
    order = getattr(method, "order", 0)  # the first chirps of a canceller are zeros
    kept = [mean_square(method.clean(t[:, None, None] * series, frame)[order:]) for t in turns]

    # Sums of 128 numbers in single precision.
    assert kept == pytest.approx(method.doppler_gain(doppler_hz, frame), rel=1e-4, abs=1e-10)
    assert MeanSubtraction().doppler_gain(np.zeros(2), frame).tolist() == [0, 0]


def test_cancellers_have_binomial_weights_and_leave_white_noise_its_power(radar):
    for order, weights in ((1, [1, -1]), (2, [1, -2, 1]), (3, [1, -3, 3, -1])):
        pulse = np.zeros((radar.frame.n_chirps, 1))
        pulse[60] = 1
        passed = MovingTargetIndication(order=order).filter_chirp_series(pulse)[:, 0]
        assert passed[60 : 61 + order] == pytest.approx(weights / np.linalg.norm(weights))
        assert np.count_nonzero(passed) == order + 1


@pytest.mark.parametrize("method", FILTERS, ids=repr)
def test_targets_below_the_speed_of_the_remark_lose_three_decibels_and_those_above_do_not(
    radar, method
):
    (told,) = method.target_findings(radar)
    slow = float(told.value.split("less than ")[1].split(" m/s")[0])
    again = float(told.value.split("multiples of ")[1].split(" m/s")[0])

    assert again == pytest.approx(2 * radar.frame.max_velocity_m_per_s, rel=1e-3)
    assert told.level == ("warning" if method == MovingTargetIndication(order=3) else "note")
    # 0.427 of a cell (1 - 2 C D + C^2 of both kernels), or where (2 sin)^2n is half of its mean.
    if isinstance(method, MeanSubtraction):
        assert slow == pytest.approx(0.427 * radar.frame.velocity_resolution_m_per_s, rel=0.02)
    else:
        share = {1: 1 / 6, 2: 0.2286, 3: 0.2625}[method.order]
        assert slow == pytest.approx(2 * share * radar.frame.max_velocity_m_per_s, rel=0.01)
    for velocity, loses in ((0.97 * slow, True), (1.03 * slow, False), (again + slow / 2, True)):
        moving = echoes(radar, (20.0, velocity))
        order = getattr(method, "order", 0)
        loss_db = -gain_db(method.clean(moving, radar.frame)[order:], moving[order:])
        assert (loss_db > 3.01) == loses


@pytest.mark.parametrize("method", FILTERS, ids=repr)
@pytest.mark.parametrize(
    "multiplexing",
    [
        dc.multiplexing.Tdm(order=(0, 1)),
        dc.multiplexing.Bpm(order=(0, 1)),
        dc.multiplexing.Ddma(order=(0, 1), n_sub_bands=4),
    ],
    ids=lambda one: one.kind(),
)
def test_each_slot_of_a_round_is_filtered_by_itself(radar, method, multiplexing):
    frame = replace(radar.frame, n_chirps=32, multiplexing=multiplexing)
    array = dc.Array(tx_m=[(0, 0, 0), (0, 5e-3, 0)], rx_m=[(0, 0, 0)])
    radar = replace(radar, frame=frame, array=array)
    still, moving = echoes(radar, (17.3, 0)), echoes(radar, (17.3, 4.0))

    assert gain_db(method.clean(still, frame), still) < -110
    doppler_hz = 2 * 4.0 / frame.chirp.wavelength_m
    left = method.clean(moving, frame)[getattr(method, "order", 0) * frame.n_slots :]
    passed_db = 10 * np.log10(float(method.doppler_gain(doppler_hz, frame)))
    # It walks by a hundredth of a cell, and 1 % of the frequency is Doppler's own spread.
    assert gain_db(left, moving) == pytest.approx(passed_db, abs=0.1)


def test_the_leakage_goes_and_a_target_that_stops_farther_out_stays(radar):
    method, frame = LeakageSubtraction(max_range_m=NEAR_M), radar.frame
    cell_m = frame.chirp.range_resolution_m
    tapered = np.hanning(frame.chirp.n_samples)

    def kept_db(samples):
        return gain_db(method.clean(samples, frame) * tapered, samples * tapered)

    for near_m in (0.2, 1.0, 3.1, NEAR_M - 1.1 * cell_m):
        assert kept_db(echoes(radar, (near_m, 0))) < -50
    for far_m in (NEAR_M + 3.1 * cell_m, 11.3, 40.0, 70.0):
        assert abs(kept_db(echoes(radar, (far_m, 0)))) < 0.1
    # A mover near the radar stays as mean subtraction leaves it.
    mover = echoes(radar, (3.0, 10.0))
    assert kept_db(mover) == pytest.approx(
        gain_db(MeanSubtraction().clean(mover, frame), mover), abs=0.01
    )
    assert method.doppler_gain(np.zeros(3), frame).tolist() == [1, 1, 1]
    assert f"nearer than {NEAR_M:.4g} m" in method.target_findings(radar)[0].value


def test_of_ramps_that_fall_the_near_ranges_are_the_near_ones(radar):
    frame = replace(radar.frame, n_chirps=32, modulation=dc.modulations.Triangular())
    radar, method = replace(radar, frame=frame), LeakageSubtraction(max_range_m=NEAR_M)
    near, far = echoes(radar, (2.0, 0)), echoes(radar, (30.0, 0))
    tapered = np.hanning(frame.chirp.n_samples)
    for slot in (slice(0, None, 2), slice(1, None, 2)):
        assert gain_db(method.clean(near, frame)[slot] * tapered, near[slot] * tapered) < -50
        assert abs(gain_db(method.clean(far, frame)[slot], far[slot])) < 0.1


@pytest.mark.parametrize("method", [*FILTERS, LeakageSubtraction(max_range_m=40.0)], ids=repr)
def test_lost_chirps_stay_lost_and_spoil_nothing(radar, method):
    still = echoes(radar, (3.0, 0), (17.3, 0))
    lost = [0, 17, 18, 90]
    still[lost] = 0
    left = method.clean(still, radar.frame)
    tapered = np.hanning(still.shape[-1])

    assert not left[lost].any()
    assert gain_db(left * tapered, still * tapered) < -60


# Noise


@pytest.mark.parametrize("window", ["hann", "rectangular", "blackman-harris"])
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
    ids=lambda methods: "+".join(one.kind() for one in methods),
)
def test_noise_has_the_power_that_is_said_to_be_left(radar, methods, sampling, window):
    radar = small(with_chirp(radar, sampling=sampling))
    over = transforms(radar, window, 40)
    left = mitigation_noise_gain(methods, radar.frame.chirp, *over)
    rng = np.random.default_rng(81)
    n_frames, total = 400, 0
    for _ in range(n_frames):
        total = total + map_of(radar, rng, methods, over) / unit(radar, over)
    mean = total / n_frames

    assert left.shape == mean.shape and left.dtype == np.float32
    rows = slice(3, -3) if sampling == "real" else slice(None)  # noise about DC is not circular
    # Each cell is a mean of 400 exponential powers over that of noise without clean-up.
    n_cells = mean[:, rows].size
    assert np.all(abs(mean - left)[:, rows] < 6 / np.sqrt(n_frames) * left[:, rows] + 1e-6)
    # All of them together, five standard errors of cells that windows tie together, 2.5 each way.
    ratio = float(np.mean(mean[:, rows])) / float(np.mean(left[:, rows]))
    assert ratio == pytest.approx(1, abs=5 * 2.5 / np.sqrt(n_frames * n_cells))


def small(radar):
    """One receiver, 32 chirps of 64 samples: many frames in a second."""
    array = dc.Array(rx_m=[(0, 0, 0)])
    frame = replace(radar.frame, n_chirps=32, chirp=replace(radar.frame.chirp, n_samples=64))
    return replace(radar, frame=frame, array=array)


def transforms(radar, window, n_velocity_bins):
    chirp, frame = radar.frame.chirp, radar.frame
    return (
        Transform(window="hann", n_points=chirp.n_samples, n_bins=chirp.n_samples),
        Transform(window=window, n_points=frame.n_chirps, n_bins=n_velocity_bins),
    )


def map_of(radar, rng, methods, over):
    samples = noise_cube(radar, rng).values[0]
    for method in methods:
        samples = method.clean(samples, radar.frame)
    return mean_power(samples, radar.frame.chirp.sampling, *over)


def unit(radar, over):
    """Noise power in a cell without clean-up, of unit noise in the samples."""
    chains = [np.sum(one.weights**2) / np.sum(one.weights) ** 2 for one in over]
    return chains[0] * chains[1] * (1 if radar.frame.chirp.sampling == "complex" else 2)


@pytest.mark.parametrize(
    "method", [MeanSubtraction(), MovingTargetIndication(order=2)], ids=lambda m: m.kind()
)
def test_false_alarms_are_as_asked_after_clean_up_under_hann(radar, method):
    radar = replace(
        radar,
        frame=replace(radar.frame, n_chirps=64, chirp=replace(radar.frame.chirp, n_samples=128)),
        array=dc.Array(rx_m=[(0, 0, 0)]),
    )
    chain = dc.Chain(cfar=dc.Cfar(estimator=dc.cfar.CellAveraging(), false_alarm_probability=1e-4))
    noise = chain.map_noise(radar)
    over = noise.range_transform, noise.doppler_transform
    left = mitigation_noise_gain((method,), radar.frame.chirp, *over)
    looked_at = usable_cells(left)
    rng = np.random.default_rng(82)
    n_frames, hits, plain = 2500, np.zeros(left.shape), 0
    for _ in range(n_frames):
        power = map_of(radar, rng, (method,), over)
        plain += np.count_nonzero(chain.cfar.exceeds_threshold(power, noise) & looked_at)
        hits += chain.cfar.exceeds_threshold(equalise(power, left), noise) & looked_at
    rates = hits.sum(axis=1) / (n_frames * np.maximum(looked_at.sum(axis=1), 1) * 1e-4)

    # 1,400 alarms or more in clusters of at most 1.9: 3.7 % standard error, and of all in the
    # rows that train across the notch, of 12 on each side, 5 %.
    searched_rows = looked_at.any(axis=1)
    assert rates[searched_rows].mean() == pytest.approx(1, abs=0.2)
    away = np.abs(np.arange(64) - 32)
    nearest = searched_rows & (away < away[searched_rows].min() + 12)
    assert 0.75 < rates[nearest].mean() < 1.3
    # Without it the slopes of the wider notch alarm all the time.
    if isinstance(method, MovingTargetIndication):
        assert plain / n_frames / np.count_nonzero(looked_at) / 1e-4 > 2


def test_rows_with_less_than_a_tenth_of_the_noise_are_not_searched(radar):
    over = transforms(radar, "hann", radar.frame.n_chirps)
    left = mitigation_noise_gain((MeanSubtraction(),), radar.frame.chirp, *over)
    middle = radar.frame.n_chirps // 2

    # The mean under a Hann taper is gone, and with it all of the row at zero velocity.
    assert np.flatnonzero(~usable_cells(left).any(axis=1)).tolist() == [middle]
    # Beside it half of that mean: 1 + 1 / 4 - 2 / 3, the correlation of neighbours under Hann.
    assert left[middle + 1] == pytest.approx(7 / 12, abs=2e-3)
    power = np.ones(left.shape, np.float32) * left
    power[middle] = 1e6  # rounding over nothing
    assert equalise(power, left) == pytest.approx(np.ones(left.shape))
    # A rectangular window has noise there that the taper does not: 1 - 2 + 1.5.
    plain = transforms(radar, "rectangular", 128)
    rectangular = mitigation_noise_gain((MeanSubtraction(),), radar.frame.chirp, *plain)
    assert rectangular[middle] == pytest.approx(1 / 2, abs=1e-6)
    assert rectangular[middle + 1] == pytest.approx(1, abs=1e-6)


def test_without_filters_all_of_the_noise_is_left(radar):
    over = transforms(radar, "hann", radar.frame.n_chirps)
    assert np.all(mitigation_noise_gain((), radar.frame.chirp, *over) == 1)


# Wrong input


@pytest.mark.parametrize("method", [*FILTERS, LeakageSubtraction(max_range_m=NEAR_M)], ids=repr)
def test_what_is_no_frame_of_the_radar_is_refused(radar, method):
    frame = radar.frame
    samples = np.ones((frame.n_chirps_total, 2, frame.chirp.n_samples), np.complex64)
    for wrong, said in (
        (samples[:-1], "127"),
        (samples[:, :, 1:], "255"),
        (samples[0], "shape"),
        (samples.real, "float32"),
        (np.where(np.arange(2)[:, None] == 0, samples, np.nan), "finite"),
    ):
        with pytest.raises(dc.InvalidSetting, match=said):
            method.clean(wrong, frame)
    short = replace(radar, frame=replace(frame, n_chirps=1))
    with pytest.raises(dc.InvalidSetting, match=method.kind()):
        method.target_findings(short)
    given = samples.copy()
    method.clean(given, frame)
    assert (given == samples).all()


def test_settings_that_cannot_work_are_refused(radar):
    for order in (0, 4, 1.5):
        with pytest.raises(dc.InvalidSetting, match="order"):
            MovingTargetIndication(order=order)
    for max_range_m in (0, -1, float("nan")):
        with pytest.raises(dc.InvalidSetting, match="max_range_m"):
            LeakageSubtraction(max_range_m=max_range_m)
    with pytest.raises(dc.InvalidSetting, match="mean-subtraction"):
        LeakageSubtraction(max_range_m=radar.frame.chirp.max_range_m).target_findings(radar)
