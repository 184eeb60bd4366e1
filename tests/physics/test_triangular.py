"""Triangles of frequency: ramps up and down, and the peaks of both brought together."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

import dechirp as dc
from dechirp.processing.refine import RefinedPeaks, Tones
from dechirp.processing.velocity_ambiguity.triangular_pairing import pair_ramps
from dechirp.radar.estimation_bounds import crlb_standard_errors
from dechirp.scene.scene_warnings import scene_findings


def triangles(radar, *, n_chirps=64, sampling="complex"):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    frame = replace(
        radar.frame, chirp=chirp, n_chirps=n_chirps, modulation=dc.modulations.Triangular()
    )
    return replace(radar, frame=frame)


def slow(radar, **chirp):
    """One triangle of 2 ms: 0.83 m and 1 m/s a beat bin."""
    made = dc.Chirp(
        start_frequency_hz=77e9, slope_hz_per_s=200e9, adc_start_s=20e-6, ramp_duration_s=1e-3,
        sample_rate_hz=1e6, n_samples=900, **{"sampling": "complex", **chirp},
    )  # fmt: skip
    frame = dc.Frame(
        chirp=made, n_chirps=1, interval_s=1e-3, modulation=dc.modulations.Triangular()
    )
    return replace(radar, frame=frame)


def ahead(range_m, velocity, rcs_m2=1.0):
    return dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=rcs_m2)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("velocity", [-45.0, -8.0, 6.0, 33.0])
def test_the_difference_of_the_beats_tells_in_which_fold_a_velocity_is(radar, velocity, sampling):
    radar = triangles(radar, sampling=sampling)
    assert radar.frame.max_velocity_m_per_s < 14
    scene = dc.Scene(targets=[ahead(20, velocity)])
    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    assert found.sizes["detection"] == 1
    # Five standard errors, and the way to the second receiver.
    assert abs(found.range - truth.range).item() < 5 * found.range_std.item() + 1e-4
    assert abs(found.velocity - truth.velocity).item() < 5 * found.velocity_std.item()
    assert found.ambiguity_number.item() == round(velocity / (2 * radar.frame.max_velocity_m_per_s))
    assert found.ambiguity_confidence.item() > 0.99


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_one_triangle_tells_ranges_and_velocities(radar, sampling):
    radar = slow(radar, sampling=sampling)
    # Beats of both ramps lie 20 bins apart and more: outside of each other's training cells.
    targets = [ahead(20, 10), ahead(45, -14, 10.0), ahead(70, 0, 30.0), ahead(105, 33, 1000.0)]
    scene = dc.Scene(targets=targets)
    found = dc.detect(dc.simulate(scene, radar, seed=2), radar)
    truth = dc.truth(scene, radar).isel(frame=0)

    order = np.argsort(found.range.values)
    assert found.sizes["detection"] == 4  # no ghost
    for name in ("range", "velocity"):
        off = abs(found[name].values[order] - truth[name].values)
        assert np.all(off < 5 * found[f"{name}_std"].values[order] + 2e-3)
    assert np.all(found.ambiguity_confidence > 0.99)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("rcs_m2", [1e-4, 10.0])
def test_ramps_of_a_wide_sweep_are_paired_whatever_walks_in_them(radar, rcs_m2, sampling):
    """3 GHz: 1.1 cells of 5 cm walked in a frame; 10 MHz apart, the two kinds of ramps have
    Doppler frequencies that differ by 1.3e-4, 100 standard errors of the stronger target's."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9, slope_hz_per_s=1e14, adc_start_s=1e-6, ramp_duration_s=32e-6,
        sample_rate_hz=10e6, n_samples=300, sampling=sampling,
    )  # fmt: skip
    frame = dc.Frame(
        chirp=chirp, n_chirps=64, interval_s=34e-6, modulation=dc.modulations.Triangular()
    )
    radar = replace(radar, frame=frame)
    scene = dc.Scene(targets=[ahead(3, 13, rcs_m2)])
    found = dc.detect(dc.simulate(scene, radar, seed=1), radar, dc.Chain(range_walk="keystone"))
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    assert found.sizes["detection"] == 1
    # Five standard errors, and 10 um for what a second receiver and half-wavelength do near by.
    assert abs(found.range - truth.range).item() < 5 * found.range_std.item() + 1e-5
    assert abs(found.velocity - truth.velocity).item() < 5 * found.velocity_std.item() + 1e-4
    assert found.ambiguity_number.item() == 0 and found.ambiguity_confidence.item() > 0.99


def test_what_folds_and_walks_in_the_maps_of_triangles_is_said_to_be_lost(radar):
    """3 GHz, 14 m/s: a fold more walks 2.5 cells, which neither map undoes."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9, slope_hz_per_s=1e14, adc_start_s=1e-6, ramp_duration_s=32e-6,
        sample_rate_hz=10e6, n_samples=300, sampling="complex",
    )  # fmt: skip
    frame = dc.Frame(
        chirp=chirp, n_chirps=64, interval_s=34e-6, modulation=dc.modulations.Triangular()
    )
    radar = replace(radar, frame=frame)
    is_found = []
    velocities = np.array([-12.0, 3.0, 10.0, 13.0, 17.0, 20.0, -24.0, 35.0, -45.0, 52.0, 60.0])
    is_told = abs(velocities) > 14
    for velocity, said in zip(velocities, is_told, strict=True):
        scene = dc.Scene(targets=[ahead(6, velocity, 10.0)])
        told = [one for one in scene_findings(scene, radar) if "range cells" in one.value]
        assert [one.level for one in told] == ["warning"] * int(said)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", dc.PhysicsWarning)
            found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
        is_found.append(np.any(abs(found.velocity.values - velocity) < 0.1))
    assert np.all(np.array(is_found)[~is_told])
    assert np.mean(np.array(is_found)[is_told]) < 0.5


def test_errors_of_one_triangle_are_at_the_bound(radar):
    radar, trials = slow(radar), 150
    rng = np.random.default_rng(3)
    scene = dc.Scene(targets=[ahead(40.3, 7.7)])
    clean = dc.simulate(scene, radar, impairments=())
    truth = dc.truth(scene, radar).isel(target=0, frame=0)
    echo_w = float(np.mean(abs(clean.values) ** 2))
    # 24 dB after integration over both ramps and receivers, 21 in each map.
    noise_w = echo_w * radar.integration_gain / 250
    std = [float(of) for of in crlb_standard_errors(radar.frame, snr=250.0)]
    errors = np.full((trials, 2), np.nan)
    for trial in range(trials):
        noise = rng.standard_normal((2, *clean.shape)) * np.sqrt(noise_w / 2)
        found = dc.detect(clean + (noise[0] + 1j * noise[1]).astype(np.complex64), radar)
        if found.sizes["detection"]:
            nearest = abs(found.range.values - truth.range.item()).argmin()
            errors[trial] = [
                (found[name].values[nearest] - truth[name].item()) / of
                for name, of in zip(("range", "velocity"), std, strict=True)
            ]
    seen = np.isfinite(errors[:, 0])
    assert seen.mean() > 0.9
    for own in errors[seen].T:
        # 5 % above the bound, and what chance allows once in a million.
        assert np.sum(own**2) < 1.05**2 * chi2.isf(1e-6, seen.sum())
        assert np.sum(own**2) > chi2.ppf(1e-6, seen.sum()) / 1.05**2


def some(tones, chosen):
    fields = ("slow", "fast", "energy", "amplitude")
    return Tones(*(getattr(tones, name)[chosen] for name in fields))


def crowd(radar, range_m, velocity, snr, rng, unlike_db=0.0):
    """Peaks of both kinds of ramps of targets (n,), with errors at the bound."""
    frame, chirp = radar.frame, radar.frame.chirp
    n = len(range_m)
    delay_hz = chirp.beat_frequency_hz(1.0) * range_m
    doppler_hz = 2 * velocity / chirp.wavelength_m
    amplitude = np.sqrt(snr) * 10 ** (rng.uniform(0, unlike_db, n) / 20)
    made = []
    for sign in (1, -1):
        std = np.sqrt(6 / (amplitude**2 * (chirp.n_samples**2 - 1)))
        fast = (delay_hz + sign * doppler_hz) * 2 * np.pi / chirp.sample_rate_hz
        noise = rng.standard_normal((2, n)) / np.sqrt(2)
        seen = amplitude * np.exp(2j * np.pi * rng.random(n)) + noise[0] + 1j * noise[1]
        tones = Tones(
            slow=np.zeros(n), fast=fast + std * rng.standard_normal(n),
            energy=abs(seen) ** 2, amplitude=seen[:, None],
        )  # fmt: skip
        order = rng.permutation(n)
        made.append((RefinedPeaks(some(tones, order), abs(seen[order]) ** 2, np.ones(n)), order))
    assert frame.n_chirps == 1
    return made


def test_a_pair_that_is_called_certain_is_one(radar):
    radar = slow(radar)
    rng = np.random.default_rng(4)
    said, right, n_targets = [], [], 0
    for _ in range(60):
        n = 6
        (up, up_is), (down, down_is) = crowd(
            radar, rng.uniform(20, 100, n), rng.uniform(-40, 40, n), 200.0, rng, unlike_db=30
        )
        found = pair_ramps(up, down, radar.frame)
        n_targets += n
        beats = found.peaks.tones.fast
        said.append(found.hypotheses.confidence)
        # Range and Doppler frequency give the two beats back, and with them the two peaks.
        turn = 2 * np.pi / radar.frame.chirp.sample_rate_hz
        of_up = up_is[abs(beats[:, None] - up.tones.fast).argmin(axis=1)]
        below = beats - 2 * found.doppler_hz * turn
        of_down = down_is[abs(below[:, None] - down.tones.fast).argmin(axis=1)]
        right.append(of_up == of_down)
    said, right = np.concatenate(said), np.concatenate(right)
    sure = said >= 0.99
    assert binom.sf((~right & sure).sum() - 1, sure.sum(), 0.02) > 1e-6
    assert sure.sum() > 0.5 * n_targets
    assert (~right).sum() <= 1.2 * (1 - said).sum() + 5 * np.sqrt((1 - said).sum())


def test_two_alike_targets_of_which_nothing_tells_are_marked(radar):
    radar, rng = slow(radar), np.random.default_rng(5)
    (up, _), (down, _) = crowd(radar, np.array([40.0, 44.0]), np.array([5.0, -5.0]), 300.0, rng)
    found = pair_ramps(up, down, radar.frame)
    assert len(found.doppler_hz) == 2
    assert np.isnan(found.hypotheses.certain_number).all()
    assert np.all(found.hypotheses.confidence < 0.9)


def test_noise_has_no_partner(radar):
    radar, rng = slow(radar), np.random.default_rng(6)
    (up, _), (down, _) = crowd(radar, np.array([40.0]), np.array([5.0]), 300.0, rng)
    lost = RefinedPeaks(some(down.tones, slice(0)), down.snr[:0], down.amplitude_noise[:0])
    assert len(pair_ramps(up, lost, radar.frame).doppler_hz) == 0


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_what_only_the_rising_ramps_hear_leaves_the_others_paired(radar):
    radar = triangles(radar)
    both = [ahead(20, 6.0), ahead(45, -33.0, 10.0)]
    cube = dc.simulate(dc.Scene(targets=both), radar, seed=3)
    more = dc.simulate(dc.Scene(targets=[*both, ahead(32, 12.0, 10.0)]), radar, seed=3)
    cube[:, ::2] = more[:, ::2]  # of every two chirps the first one rises
    found = dc.detect(cube, radar)
    truth = dc.truth(dc.Scene(targets=both), radar).isel(frame=0)

    order = np.argsort(found.range.values)
    assert found.sizes["detection"] == 2
    for name in ("range", "velocity"):
        off = abs(found[name].values[order] - truth[name].values)
        # Five standard errors, and the way to the second receiver.
        assert np.all(off < 5 * found[f"{name}_std"].values[order] + 1e-4)


def test_what_does_not_know_of_falling_ramps_is_refused(radar):
    radar = triangles(radar, n_chirps=4)
    scene = dc.Scene(targets=[ahead(20, 0)])
    with pytest.raises(dc.InvalidSetting, match="triangular, with an impairment of kind pll"):
        dc.simulate(scene, radar, impairments=[dc.impairments.Pll(natural_frequency_hz=3e5)])
    with pytest.raises(dc.InvalidSetting, match="tail, with ramps that differ"):
        dc.simulate(scene, radar, engine=dc.Engine(late="tail"))
    with pytest.raises(dc.InvalidSetting, match="only one of the two"):
        replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1)))
