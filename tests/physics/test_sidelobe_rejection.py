"""Directions, ranges and velocities beside stronger echoes that point targets do not describe."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import dechirp as dc
from dechirp.certificate.resolution import run_resolution_trials
from dechirp.experiments.run import _masked_direction_findings
from dechirp.processing.frame import process_frame
from dechirp.processing.refine import refine_tones
from nightly import NIGHTLY, nightly, nightly_except
from radars import eight_receiver_radar

N_TRIALS = 80
N_TRIALS_AT_LIMIT = 900
"""Trials after which the mean of squares, of an expectation of 1.04 (that of noise estimated from
8 cells of 8 channels), exceeds 1.3 with a probability of 4e-7, by chi-square."""
STATIC_CFAR = dc.Cfar(
    estimator=dc.cfar.CellAveraging(),
    n_training=dc.Cells(range=0, velocity=4),
    n_guard=dc.Cells(range=0, velocity=3),
    false_alarm_probability=1e-6,
)
"""Static echoes: cells at other velocities contain only noise."""


def make_radar(n_chirps=16):
    """Return a radar with range cells of 0.6 m and eight receivers about the origin."""
    radar = eight_receiver_radar()
    line = dc.Array(rx_m=[(0, (k - 3.5) * 0.00193, 0) for k in range(8)])
    return replace(radar, frame=replace(radar.frame, n_chirps=n_chirps), array=line)


def simulate_tones(radar, rng, *, range_cells, velocity_cells, azimuths, amplitudes, snr_db):
    """Simulate tones at cells of the map; noise is `snr_db` below a unit tone in its cell."""
    frame = radar.frame
    n, m = np.arange(frame.chirp.n_samples), np.arange(frame.n_chirps)
    y_wavelengths = np.array(radar.array.rx_m)[:, 1] / frame.chirp.wavelength_m
    samples = np.einsum(
        "t,tm,tk,tn->mkn",
        amplitudes,
        np.exp(2j * np.pi * np.outer(velocity_cells, m) / m.size),
        # Phases over receivers as of the simulator: they fall with a shorter path.
        np.exp(-2j * np.pi * np.outer(np.sin(azimuths), y_wavelengths)),
        np.exp(2j * np.pi * np.outer(range_cells, n) / n.size),
    )
    sigma = np.sqrt(10 ** (-snr_db / 10) * n.size * m.size / 2)
    samples += sigma * (rng.normal(size=samples.shape) + 1j * rng.normal(size=samples.shape))
    cube = dc.simulate(dc.Scene(targets=[]), radar, impairments=())
    return cube.copy(data=samples[None].astype(np.complex64))


def simulate_beside_extended_echo(radar, rng, *, n_cells, ratio_db, extent_cells=2):
    """Simulate a static target and twelve scatterers in a few cells behind it.

    `ratio_db`: power of all scatterers relative to the target's, which is 30 dB over the noise in
    each channel. Returns the cube, and range and azimuth of the target.
    """
    range_cells, azimuth_rad = 20 + rng.random(), rng.uniform(-0.8, 0.8)
    extents = np.concatenate([[0.0], n_cells + extent_cells * rng.random(12)])
    azimuths = np.concatenate([[azimuth_rad], rng.uniform(-0.8, 0.8) + 0.1 * rng.normal(size=12)])
    amplitudes = rng.normal(size=13) + 1j * rng.normal(size=13)
    amplitudes[0] /= abs(amplitudes[0])
    amplitudes[1:] *= 10 ** (ratio_db / 20) / np.linalg.norm(amplitudes[1:])
    cube = simulate_tones(
        radar,
        rng,
        range_cells=range_cells + extents,
        velocity_cells=np.zeros(13),
        azimuths=azimuths,
        amplitudes=amplitudes,
        snr_db=30,
    )
    return cube, range_cells * radar.frame.chirp.range_resolution_m, azimuth_rad


def measure_squared_errors(radar, chain, *, n_cells, ratio_db, n_trials=N_TRIALS, extent_cells=2):
    """Return squared errors of azimuth, range and velocity over their variances, (n_listed, 3).

    Those of all detections with a direction within a cell of the target: a sidelobe counts too.
    """
    rng = np.random.default_rng([n_cells, ratio_db])
    squares = []
    for _ in range(n_trials):
        cube, range_m, azimuth_rad = simulate_beside_extended_echo(
            radar, rng, n_cells=n_cells, ratio_db=ratio_db, extent_cells=extent_cells
        )
        found = dc.detect(cube, radar, chain)
        is_target = (abs(found.range - range_m) < 0.6) & np.isfinite(found.azimuth)
        for row in np.flatnonzero(is_target):
            detection = found.isel(detection=row)
            squares.append(
                (
                    ((detection.azimuth - azimuth_rad) / detection.azimuth_std).item() ** 2,
                    ((detection.range - range_m) / detection.range_std).item() ** 2,
                    (detection.velocity / detection.velocity_std).item() ** 2,
                )
            )
    return np.array(squares).reshape(-1, 3)


@pytest.mark.parametrize(
    ("n_cells", "ratio_db", "min_share"),
    # Share of the trials with a direction: the map's Hann window hides the target in the others.
    nightly_except(
        [(3, 20, 0.8), (10, 70, 0.3)],
        [
            (3, 20, 0.8),
            (5, 40, 0.8),
            (10, 40, 0.9),
            (10, 70, 0.3),
            (20, 60, 0.9),
            (30, 20, 0.9),
            (30, 80, 0.9),
        ],
    ),
)
def test_errors_beside_extended_echo_match_stated_ones(n_cells, ratio_db, min_share):
    n_trials = N_TRIALS_AT_LIMIT if NIGHTLY and min_share >= 0.8 else N_TRIALS
    squares = measure_squared_errors(
        make_radar(),
        dc.Chain(cfar=STATIC_CFAR),
        n_cells=n_cells,
        ratio_db=ratio_db,
        n_trials=n_trials,
    )

    # The mean of n squares of normal numbers is chi-square with n degrees, over n.
    chance = chi2.ppf(1 - 1e-7, len(squares)) / len(squares) if n_trials == N_TRIALS else 1.0
    assert len(squares) >= min_share * n_trials
    assert np.all(squares.mean(axis=0) <= 1.3 * chance)


@nightly
@pytest.mark.parametrize(
    ("n_cells", "ratio_db", "n_trials"),
    [
        (12, 75, 130),
        (10, 70, 1200),
        (12, 75, 1200),
        (12, 70, 1000),
        (8, 62, 1000),
        (6, 50, 1000),
    ],
)
def test_no_sidelobe_beside_extended_echo_is_listed_as_target(n_cells, ratio_db, n_trials):
    """Two sidelobes beside a target on both sides were listed, 0.35 m off with errors of 0.3 mm."""
    squares = measure_squared_errors(
        make_radar(),
        dc.Chain(cfar=STATIC_CFAR),
        n_cells=n_cells,
        ratio_db=ratio_db,
        n_trials=n_trials,
    )

    # Measured over 500 to 800 trials: 1.23 at most. The mean of 700 squares of an expectation of
    # 1.04, that of noise estimated from 8 cells of 8 channels, exceeds 1.3 once in 1e6.
    chance = 1.0 if n_trials >= 1000 else chi2.ppf(1 - 1e-7, len(squares)) / len(squares)
    assert len(squares) >= 0.5 * n_trials
    assert np.all(squares.mean(axis=0) < 1.3 * chance)


@nightly
@pytest.mark.parametrize("ratio_db", [45, 60, 70])
def test_errors_beside_extended_echo_32_cells_away_match_stated_ones(ratio_db):
    """The sums of 4 samples that start the estimate alias the echo onto the target."""
    squares = measure_squared_errors(
        make_radar(), dc.Chain(cfar=STATIC_CFAR), n_cells=28, ratio_db=ratio_db, extent_cells=6
    )

    # Measured along range: 0.9 to 1.1; 4.6 with the start by aliased sums, at 60 dB.
    limit = chi2.ppf(1 - 1e-7, len(squares)) / len(squares)
    assert len(squares) >= 0.9 * N_TRIALS
    assert np.all(squares.mean(axis=0) < limit)


def make_array_radar(kind):
    """Return the radar of `make_radar` with other channels or samples."""
    radar = make_radar()
    if kind == "six receivers":
        receivers = dc.Array(rx_m=[(0, (k - 2.5) * 0.00193, 0) for k in range(6)])
        return replace(radar, array=receivers)
    if kind == "real samples":
        chirp = radar.frame.chirp
        real = replace(
            chirp,
            sampling="real",
            n_samples=2 * chirp.n_samples,
            sample_rate_hz=2 * chirp.sample_rate_hz,
        )
        return replace(radar, frame=replace(radar.frame, chirp=real))
    return replace(
        radar,
        frame=replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1))),
        array=dc.Array(
            tx_m=[(0, -2 * 0.00193, 0), (0, 2 * 0.00193, 0)],
            rx_m=[(0, (k - 1.5) * 0.00193, 0) for k in range(4)],
        ),
    )


@nightly
@pytest.mark.parametrize("kind", ["six receivers", "two transmitters", "real samples"])
@pytest.mark.parametrize(("n_cells", "ratio_db"), [(3, 20), (5, 40), (10, 60), (30, 80)])
def test_directions_of_other_arrays_contain_extended_echo(kind, n_cells, ratio_db):
    """Point targets of the simulator, with range-Doppler coupling, thermal noise and walk."""
    radar, n_trials = make_array_radar(kind), 40
    cell_m = radar.frame.chirp.range_resolution_m
    alone = dc.Scene(targets=[dc.Target(position_m=(21 * cell_m, 0, 0), rcs_m2=1)])
    rcs_m2 = 10**3.9 / dc.truth(alone, radar).snr.item()  # 39 dB
    rng, squares = np.random.default_rng([n_cells, ratio_db]), []
    for _ in range(n_trials):
        range_m, azimuth_rad = (20 + rng.random()) * cell_m, rng.uniform(-0.8, 0.8)
        ranges_m = range_m + np.concatenate([[0], (n_cells + 2 * rng.random(12)) * cell_m])
        azimuths = rng.uniform(-0.8, 0.8) + 0.1 * rng.normal(size=13)
        powers = rng.exponential(size=13)
        powers *= 10 ** (ratio_db / 10) / powers[1:].sum() * (ranges_m / range_m) ** 4
        azimuths[0], powers[0] = azimuth_rad, 1
        targets = [
            dc.Target(
                name=str(i),
                position_m=(
                    ranges_m[i] * np.cos(azimuths[i]),
                    ranges_m[i] * np.sin(azimuths[i]),
                    0,
                ),
                rcs_m2=rcs_m2 * powers[i],
            )
            for i in range(13)
        ]
        cube = dc.simulate(dc.Scene(targets=targets), radar, seed=int(rng.integers(1 << 31)))
        found = dc.detect(cube, radar, dc.Chain(cfar=STATIC_CFAR))
        distances_m = abs(found.range.values - range_m)
        if distances_m.min(initial=np.inf) < cell_m:
            nearest = found.isel(detection=int(distances_m.argmin()))
            squares.append(((nearest.azimuth - azimuth_rad) / nearest.azimuth_std).item() ** 2)
    known = np.array(squares)[np.isfinite(squares)]

    # Measured in 36 cases of 60 trials: 0.3 to 1.15.
    assert known.size >= 0.5 * n_trials
    assert known.mean() < chi2.ppf(1 - 1e-7, known.size) / known.size


@nightly
def test_target_in_sidelobes_that_no_window_removes_has_no_direction():
    squares = measure_squared_errors(
        make_radar(), dc.Chain(cfar=STATIC_CFAR), n_cells=3, ratio_db=40, n_trials=40
    )

    # 40 dB over the target at 3 cells, where a Hann window leaves 38 to 48 dB less: the few
    # directions that remain have stated errors that contain the sidelobes.
    assert len(squares) < 20
    assert np.all(squares < chi2.ppf(1 - 1e-8, 1))


def test_directions_masked_by_sidelobes_are_reported():
    radar, chain = make_radar(), dc.Chain(cfar=STATIC_CFAR).fit_to_radar(make_radar())
    rng = np.random.default_rng(5)
    cell_m = radar.frame.chirp.range_resolution_m
    masked_m, nan_m, near_m = [], [], []
    for _ in range(20):
        cube, *_ = simulate_beside_extended_echo(radar, rng, n_cells=3, ratio_db=38)
        frame = process_frame(cube.values[0], radar, chain)
        masked_m.extend(frame.masked_ranges_m)
        is_nan = np.isnan(frame.detections["azimuth"])
        nan_m.extend(frame.detections["range"][is_nan])
        near = process_frame(cube.values[0], radar, replace(chain, max_range_m=21 * cell_m))
        near_m.extend(near.masked_ranges_m)

    assert len(nan_m) > 0
    assert near_m == [range_m for range_m in masked_m if range_m <= 21 * cell_m]
    assert 0 < len(near_m) < len(masked_m)
    # The ranges are those of the beat frequencies, of targets at rest.
    assert masked_m == pytest.approx(nan_m, abs=0.1 * cell_m)
    (finding,) = _masked_direction_findings(masked_m, cell_m)
    assert finding.setting == "chain.angle" and f"{len(nan_m)} detections" in finding.value
    far_m = 100 * cell_m
    (finding,) = _masked_direction_findings([2.0, far_m, 2.0 + cell_m], cell_m)
    assert f"at 2 to {2 + cell_m:.3g}, {far_m:.3g} m" in finding.value
    assert "no direction for 1 detection beside" in _masked_direction_findings([2.0], 1.0)[0].value


@nightly
@pytest.mark.parametrize(
    ("range_offset_cells", "velocity_offset_cells"),
    [(4, 4), *((n, 0) for n in range(4, 9)), *((0, n) for n in range(4, 9))],
)
def test_undetected_echo_beside_strong_target_does_not_bias_it(
    range_offset_cells, velocity_offset_cells
):
    """An echo 40 dB weaker, which the detector drops in the training cells of a target of 60 dB."""
    radar = make_radar(n_chirps=64)
    frame = radar.frame
    rng = np.random.default_rng(11)
    squares, n_trials, n_hidden = [], 300, 0
    for _ in range(n_trials):
        range_cells, velocity_cells = 20 + rng.random(), rng.uniform(-0.5, 0.5)
        azimuths = rng.uniform(-0.8, 0.8, 2)
        offset_cells = np.array([range_offset_cells, velocity_offset_cells])
        cells = np.array([[0, 0], offset_cells + rng.uniform(-0.5, 0.5, 2)])
        cube = simulate_tones(
            radar,
            rng,
            range_cells=range_cells + cells[:, 0],
            velocity_cells=velocity_cells + cells[:, 1],
            azimuths=azimuths,
            amplitudes=np.array([1, 0.01]) * np.exp(2j * np.pi * rng.random(2)),
            snr_db=60,
        )
        found = dc.detect(cube, radar)
        n_hidden += found.sizes["detection"] == 1
        found = found.isel(detection=0)  # the strongest
        beat_hz = range_cells / frame.chirp.n_samples * frame.chirp.sample_rate_hz
        doppler_hz = velocity_cells / (frame.n_chirps * frame.repetition_s)
        range_m = frame.chirp.range_m(1.0) * (beat_hz - doppler_hz)
        squares.append(
            [
                ((found.range - range_m) / found.range_std).item() ** 2,
                (
                    (found.velocity - velocity_cells * frame.velocity_resolution_m_per_s)
                    / found.velocity_std
                ).item()
                ** 2,
                ((found.azimuth - azimuths[0]) / found.azimuth_std).item() ** 2,
            ]
        )

    assert n_hidden > 0.98 * n_trials
    # Measured in 300 trials: 0.55 to 1.14; unwindowed estimates had 7 along range and 2.4 along
    # velocity. The limit is 1.47.
    limit = chi2.ppf(1 - 1e-7, n_trials) / n_trials
    assert np.all(np.mean(squares, axis=0) < limit)


@pytest.mark.parametrize(
    ("offset_cells", "ratio_db"),
    nightly_except(
        [((0, 2), 10), ((1, 0), 20)],
        [
            (cells, ratio_db)
            for cells in [(1, 0), (0, 1), (1.5, 0), (0, 1.5), (2, 0), (0, 2), (3, 0), (0, 4)]
            for ratio_db in (10, 20, 40)
        ],
    ),
    ids=str,
)
def test_errors_of_strong_target_contain_echo_within_four_cells(offset_cells, ratio_db):
    """A weaker echo that is merged with the target, or that the detector finds beside it."""
    radar = make_radar(n_chirps=64)
    frame, n_trials = radar.frame, 50
    rng = np.random.default_rng([int(2 * max(offset_cells)), offset_cells[1] > 0, ratio_db])
    squares = np.empty((n_trials, 3))
    for trial in range(n_trials):
        range_cells, velocity_cells = 20 + rng.random(), rng.uniform(-0.5, 0.5)
        azimuths, apart = rng.uniform(-0.8, 0.8, 2), np.array(offset_cells, float)
        # Anywhere within half a cell on the other axis, within a quarter on its own.
        apart += np.where(apart, 0.25, 0.5) * rng.uniform(-1, 1, 2)
        cells = np.array([[0, 0], apart])
        cube = simulate_tones(
            radar,
            rng,
            range_cells=range_cells + cells[:, 0],
            velocity_cells=velocity_cells + cells[:, 1],
            azimuths=azimuths,
            amplitudes=np.array([1, 10 ** (-ratio_db / 20)]) * np.exp(2j * np.pi * rng.random(2)),
            snr_db=60,
        )
        found = dc.detect(cube, radar)
        found = found.isel(detection=int(np.argmax(found.snr.values)))
        beat_hz = range_cells / frame.chirp.n_samples * frame.chirp.sample_rate_hz
        doppler_hz = velocity_cells / (frame.n_chirps * frame.repetition_s)
        range_m = frame.chirp.range_m(1.0) * (beat_hz - doppler_hz)
        velocity = velocity_cells * frame.velocity_resolution_m_per_s
        for axis, (name, true) in enumerate(
            zip(("range", "velocity", "azimuth"), (range_m, velocity, azimuths[0]), strict=True)
        ):
            squares[trial, axis] = ((found[name] - true) / found[f"{name}_std"]).item() ** 2

    # Measured: 0.1 to 1.5; 88 along range before the other echo counted, at (0, 2) and 10 dB.
    assert np.all(squares.mean(axis=0) < chi2.ppf(1 - 1e-7, n_trials) / n_trials)


@nightly
def test_static_echoes_widen_the_error_of_a_static_velocity_by_little():
    radar = make_radar(n_chirps=64)
    cell = radar.frame.velocity_resolution_m_per_s
    rng, n_trials = np.random.default_rng(4), 30
    ratios, squares = np.empty((2, n_trials))
    for trial in range(n_trials):
        cube, range_m, _ = simulate_beside_extended_echo(radar, rng, n_cells=3, ratio_db=20)
        found = dc.detect(cube, radar, dc.Chain(cfar=STATIC_CFAR))
        found = found.isel(detection=int(np.argmin(abs(found.range.values - range_m))))
        lone_std = np.sqrt(6 / found.snr) / (2 * np.pi) * cell
        ratios[trial] = (found.velocity_std / lone_std).item()
        squares[trial] = (found.velocity / found.velocity_std).item() ** 2

    # Echoes up to half a cell of velocity apart would widen it by a factor of 7 (median).
    assert np.median(ratios) < 5
    assert np.mean(squares) < chi2.ppf(1 - 1e-7, n_trials) / n_trials


def test_two_tones_two_bins_apart_are_refined_until_they_change_no_more():
    n = np.arange(64)
    slow, fast = 2 * np.pi * np.array([3.1, 3.3]) / 64, 2 * np.pi * np.array([10.2, 12.1]) / 64
    samples = sum(
        a * np.exp(1j * (s * n[:, None] + f * n))
        for a, s, f in zip((1, 0.3j), slow, fast, strict=True)
    )
    tones = refine_tones(
        samples[:, None].astype(np.complex64),
        slow + 0.2 * 2 * np.pi / 64,
        fast - 0.2 * 2 * np.pi / 64,
        noise_power=np.full(2, 1e-6),
    )

    # Three passes leave 6e-5 bins, the Cramer-Rao bound at 76 dB in the map.
    bins = 64 / (2 * np.pi)
    assert abs(tones.fast - fast).max() * bins < 1e-5
    assert abs(tones.slow - slow).max() * bins < 1e-5


@nightly
def test_equal_targets_one_and_a_half_cells_apart_are_not_merged():
    # A Hann window merges them: both would be detected in 91 of 100 trials instead of all.
    trials = run_resolution_trials(
        np.random.default_rng(3), 60, window="rectangular", separations_bins=(1.5,)
    )

    assert trials[:, 1].all()
