"""Phase monopulse, by its formula and to its own bound."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture, FieldOfView
from dechirp.processing.angle.monopulse import Monopulse, displaced_pairs
from dechirp.theory.bounds import angle_std_rad


def on_line(left):
    left = np.asarray(left, float)
    return np.stack([0 * left, left, 0 * left], axis=1)


def noise(shape, rng):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def trials(seen, n, rng, *, most=(1.1, 0.4)):
    truth = [
        rng.uniform(-one, one, n) * told for one, told in zip(most, seen.resolves, strict=True)
    ]
    x = 10 * seen.steering_vectors(*truth) + noise((n, seen.n_elements), rng)
    return truth, Monopulse().find_directions(x[:, None], seen, np.ones(n))


def test_two_elements_tell_the_arc_sine_of_their_phase():
    seen = Aperture(on_line([0, 0.45]))
    for phase in (-2.0, -0.3, 0.0, 1.1):
        # The element to the left is nearer to a target on the left: its phase lags.
        x = np.array([[[1.0, np.exp(-1j * phase)]]])
        found = Monopulse().find_directions(x, seen, np.full(1, 1e-4))
        assert found.azimuth_rad[0, 0] == pytest.approx(np.arcsin(phase / (2 * np.pi * 0.45)))


@pytest.mark.parametrize(
    ("left", "equal"),
    [
        ([0, 0.5], 0.5),
        # Noise of all but the ends cancels.
        (np.arange(8) / 2, 3.5),
        # Two chains of pairs half a wavelength apart, 7 pairs with 4 ends.
        (np.arange(9) / 4, 7 * 0.5 / np.sqrt(2)),
        # Two pairs without a common element.
        ([0, 0.5, 3.0, 3.5], 0.5 * np.sqrt(2)),
    ],
)
def test_a_line_is_as_good_as_two_elements_so_far_apart(left, equal):
    seen, n = Aperture(on_line(left)), 2000
    (azimuth, _), found = trials(seen, n, np.random.default_rng(91))
    error = found.azimuth_rad[:, 0] - azimuth
    bound = angle_std_rad(snr=100, positions_m=[0, equal], wavelength_m=1.0, angle_rad=azimuth)
    # The standard error of a ratio over 2,000 trials is 0.016.
    assert np.sqrt(np.mean((error / bound) ** 2)) == pytest.approx(1, abs=0.1)
    assert 0.85 < np.mean((error / found.azimuth_std_rad[:, 0]) ** 2) < 1.15


@pytest.mark.parametrize("holes", [False, True])
def test_a_plane_tells_both_angles_with_true_errors(holes):
    grid = np.array([(0, y / 2, z / 2) for y in range(5) for z in range(4)])
    chosen = [0, 1, 2, 4, 5, 7, 9, 10, 11, 13, 15, 19] if holes else slice(None)
    seen, n = Aperture(grid[chosen], FieldOfView(elevation_rad=1.0)), 2000
    truth, found = trials(seen, n, np.random.default_rng(92))
    for axis in (0, 1):
        error = (found[axis][:, 0] - truth[axis]) / found[axis + 2][:, 0]
        assert 0.85 < np.mean(error**2) < 1.15


def test_pairs_of_a_sparse_plane_need_not_lie_along_its_axes():
    seen = Aperture(np.array([(0, 0, 0), (0, 0.3, 0.2), (0, -0.2, 0.35)]))
    (azimuth, elevation), found = trials(seen, 2000, np.random.default_rng(93), most=(0.6, 0.2))
    for truth, at, std in (
        (azimuth, found.azimuth_rad, found.azimuth_std_rad),
        (elevation, found.elevation_rad, found.elevation_std_rad),
    ):
        assert 0.85 < np.mean(((at[:, 0] - truth) / std[:, 0]) ** 2) < 1.15
    one, two = (pairs.displacement for pairs in displaced_pairs(seen))
    assert abs(one[0] * two[1] - one[1] * two[0]) > 0.05


def test_beyond_half_a_wavelength_the_whole_array_chooses_the_branch():
    seen = Aperture(on_line([0, 0.8, 1.6, 2.7]))
    (azimuth, _), found = trials(seen, 2000, np.random.default_rng(94))
    assert np.all(abs(found.azimuth_rad[:, 0] - azimuth) < 7 * found.azimuth_std_rad[:, 0])


def test_several_sources_are_refused():
    for wrong in (2, "mdl"):
        with pytest.raises(dc.InvalidSetting, match="n_sources"):
            Monopulse(n_sources=wrong)


def test_an_array_without_pairs_at_one_depth_is_refused():
    staggered = Aperture(np.array([(0, 0, 0), (0.1, 0.5, 0), (0.2, 1.0, 0)]))
    with pytest.raises(dc.InvalidSetting, match="bartlett"):
        Monopulse().find_directions(np.ones((1, 1, 3)), staggered, np.ones(1))
