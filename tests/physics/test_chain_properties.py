"""Laws of the whole chain: superposition, scale, power, and what must make no odds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.config import loading
from dechirp.config.dumping import dump
from dechirp.processing.detect import FrameProcessor
from dechirp.processing.spectrum import (
    Transform,
    mean_power,
    range_doppler,
    range_spectrum,
    split_spectrum,
)
from small_radars import CODES, WINDOWS, chain, echoes, scenes, small

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
EPS = float(np.finfo(np.float32).eps)
few = settings(max_examples=8)
seeds = st.integers(0, 2**32 - 1)


@few
@given(scenes(), st.data())
def test_echoes_superpose(seen, data):
    radar, scene = seen
    first = data.draw(st.integers(0, len(scene.targets)))
    parts = [scene.targets[:first], scene.targets[first:]]
    alone = sum(echoes(dc.Scene(targets=part), radar) for part in parts)
    both = echoes(scene, radar)
    np.testing.assert_allclose(both, alone, rtol=0, atol=1e-11 * abs(both).max())


@few
@given(scenes(), st.integers(-10, 10))
def test_four_times_the_cross_section_is_twice_the_echo_to_the_bit(seen, k):
    radar, scene = seen
    grown = [replace(one, rcs_m2=one.rcs_m2 * 4.0**k) for one in scene.targets]
    np.testing.assert_array_equal(
        echoes(dc.Scene(targets=grown), radar), 2.0**k * echoes(scene, radar)
    )


def spectra_of(samples, sampling, window, n_more):
    transforms = [
        Transform(window=window, n_points=n, n_bins=n + n_more)
        for n in (samples.shape[2], samples.shape[0])
    ]
    split = split_spectrum(samples, sampling, *transforms)
    kept = range_spectrum(samples, sampling, transforms[0])
    return [
        range_doppler(samples, sampling, *transforms),
        split[:, :, 0] + 1j * split[:, :, 1],
        kept,
    ]


def drawn(rng, sampling, shape):
    samples = rng.standard_normal(shape)
    if sampling == "real":
        return samples.astype(np.float32)
    return (samples + 1j * rng.standard_normal(shape)).astype(np.complex64)


@few
@given(
    seeds,
    st.sampled_from(["complex", "real"]),
    st.sampled_from(WINDOWS),
    st.sampled_from([0, 32]),
    st.floats(-3, 3),
)
def test_spectra_are_linear(seed, sampling, window, n_more, share):
    rng = np.random.default_rng(seed)
    x, y = (drawn(rng, sampling, (32, 2, 64)) for _ in range(2))
    sums = spectra_of((x + np.float32(share) * y).astype(x.dtype), sampling, window, n_more)
    for both, of_x, of_y in zip(
        sums,
        spectra_of(x, sampling, window, n_more),
        spectra_of(y, sampling, window, n_more),
        strict=True,
    ):
        size = np.sqrt(np.mean(abs(both) ** 2))
        # Three spectra, the parts up to four times the sum, each cell right to 10 eps of its rms.
        assert abs(both - (of_x + np.float32(share) * of_y)).max() < 100 * EPS * size


@few
@given(
    seeds,
    st.sampled_from(WINDOWS),
    st.sampled_from([0, 7, 64]),
    st.sampled_from(["complex", "real"]),
)
def test_a_map_holds_the_power_of_the_weighted_samples(seed, window, n_more, sampling):
    """Parseval: through windows, zero padding, and the half spectrum of real samples."""
    samples = drawn(np.random.default_rng(seed), sampling, (32, 2, 96))
    fast, slow = (
        Transform(window=window, n_points=n, n_bins=n + n_more)
        for n in (samples.shape[2], samples.shape[0])
    )
    power = mean_power(samples, sampling, fast, slow).astype(float)
    tapered = samples * slow.weights[:, None, None] * fast.weights
    tapered /= slow.weights.sum() * fast.weights.sum()
    expected = fast.n_bins * slow.n_bins * (abs(tapered) ** 2).sum() / samples.shape[1]
    if sampling == "real":
        # Twice the power of each half, so that a tone keeps its own; the rows 0 and N / 2
        # are their own images.
        own = power[:, 0].sum() + (power[:, -1].sum() if fast.n_bins % 2 == 0 else 0.0)
        assert power.sum() == pytest.approx(expected + own / 2, rel=10 * EPS)
    else:
        assert power.sum() == pytest.approx(expected, rel=10 * EPS)


def columns_equal(found, expected, **tolerance):
    assert found.sizes == expected.sizes
    for name in expected.data_vars:
        np.testing.assert_allclose(found[name], expected[name], err_msg=name, **tolerance)


@few
@given(scenes(), seeds, st.sampled_from(WINDOWS), st.floats(-12, 6), st.integers(-40, 20))
def test_no_positive_factor_changes_what_is_found(seen, seed, window, decades, doublings):
    radar, scene = seen
    # Real samples and a median of the ring, whose ranks a rounding may not swap by much.
    cube = dc.simulate(scene, radar, seed=seed)
    expected = dc.detect(cube, radar, chain(window))
    turned = dc.detect(cube * np.float32(2.0**doublings), radar, chain(window))
    columns_equal(turned, expected, rtol=0, atol=0)
    scaled = dc.detect((cube * np.float32(10.0**decades)).astype(cube.dtype), radar, chain(window))
    # Rounding each sample to half a unit is noise 150 dB under it.
    columns_equal(scaled, expected, rtol=1e-4, atol=1e-6)


@few
@given(scenes(), seeds, st.integers(-20, 20))
def test_a_map_scales_as_the_square_to_the_bit(seen, seed, doublings):
    radar, scene = seen
    one = dc.simulate(scene, radar, seed=seed).isel(frame=0)
    power, scaled = (
        dc.power_map(cube, radar, chain()) for cube in (one, one * np.float32(2.0**doublings))
    )
    np.testing.assert_array_equal(scaled, power * np.float32(4.0**doublings))


@pytest.mark.parametrize("exponent", [-100, -60, 50, 90])
def test_maps_that_scores_look_at_keep_the_unit_of_the_samples(exponent):
    radar = small()
    cube = dc.simulate(dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))]), radar, seed=1)
    level = np.float32(2.0 ** -np.frexp(float(abs(cube).max()))[1])
    seen = []
    for scale in (1.0, np.float32(2.0**exponent)):
        (frame,) = FrameProcessor(radar, chain()).process([cube * level * scale])
        seen += frame.equalised_power
    with np.errstate(over="ignore", under="ignore"):
        np.testing.assert_array_equal(seen[1], np.ldexp(seen[0], 2 * exponent))


@few
@given(scenes(), seeds)
def test_frames_may_come_in_any_order(seen, seed):
    radar, scene = seen
    cube = dc.simulate(scene, radar, n_frames=2, seed=seed)
    there = dc.detect(cube, radar, chain())
    back = dc.detect(cube.isel(frame=[1, 0]), radar, chain())
    for number in (0, 1):
        one = there.isel(detection=there.frame.values == number)
        other = back.isel(detection=back.frame.values == 1 - number)
        columns_equal(other.drop_vars("frame"), one.drop_vars("frame"), rtol=0, atol=0)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("code", CODES, ids=str)
def test_detections_are_the_same_bits_for_any_number_of_threads(monkeypatch, sampling, code):
    radar = small(sampling, code)
    made = [dc.Target(position_m=(x, y, 0), rcs_m2=10) for x, y in ((10, 1), (18, -3), (27, 0))]
    found = []
    for n_threads in (1, 2, 5):
        monkeypatch.setattr("numba.get_num_threads", lambda n=n_threads: n)
        cube = dc.simulate(dc.Scene(targets=made), radar, seed=3)
        found.append(dc.detect(cube, radar, chain()))
    assert found[0].sizes["detection"] >= 3
    for other in found[1:]:
        assert other.identical(found[0])


@few
@given(scenes(), st.integers(0, 10**6), st.sampled_from(WINDOWS))
def test_a_scenario_that_was_written_and_read_gives_the_same_bits(seen, seed, window):
    radar, scene = seen
    scene = dc.Scene(targets=[replace(t, name=f"t{i}") for i, t in enumerate(scene.targets)])
    scenario = dc.Scenario(radar=radar, scene=scene, seed=seed, chain=chain(window))
    again = loading.parse_settings(dump(scenario), dc.Scenario)
    cubes, found = [], []
    for one in (scenario, again):
        cubes.append(dc.simulate(one.scene, one.radar, seed=one.seed))
        found.append(dc.detect(cubes[-1], one.radar, one.chain))
    assert cubes[1].identical(cubes[0])
    assert found[1].identical(found[0])
