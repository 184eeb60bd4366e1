"""Clean-up of real recordings: it spares the car, and the ghost is told from all echoes."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.mitigation.apply import apply_mitigation
from dechirp.processing.mitigation.base import Mitigation
from dechirp.processing.mitigation.leakage_subtraction import LeakageSubtraction
from dechirp.processing.mitigation.noise_loss import equalise, mitigation_noise_gain
from dechirp.processing.quality.synchronous_interference import find_ghost_track
from recordings.opened import RECORDINGS, ROADSIDE, opened

GHOST = "20181128-214451.bin"
CLEAN = "20180613-190347.bin"


def example(member):
    return LeakageSubtraction(max_range_m=3.0) if member is LeakageSubtraction else member()


def samples_of(cube):
    kind = np.complex64 if np.iscomplexobj(cube) else np.float32
    return np.ascontiguousarray(cube.values[0], kind)


@pytest.mark.parametrize(
    ("folder", "name"), [(folder, name) for folder, names in RECORDINGS.items() for name in names]
)
def test_the_ghost_is_told_and_nothing_in_any_other_recording(real_data, folder, name):
    recording = opened(real_data / folder, name)
    if not recording.sizes:
        return  # points, without samples
    found = []
    for index, cube in enumerate(recording.frames()):
        samples = samples_of(cube)
        lost = np.zeros(len(samples), bool)
        frame = recording.radar.frame.for_frame(index)
        found.append(find_ghost_track(samples, lost, frame, float(abs(samples).max()) or 1.0))
    speeds = [one.velocity_m_per_s for one in found]

    if name != GHOST:
        assert np.isnan(speeds).all()
        return
    # The collection saw it at 27.4 m and +24 m/s, smeared over 2.2 m: 1,004 m/s take it from
    # 25.5 m to 28.5 m in the 102 chirps in which it is, and 24 m/s are what 15 folds leave of it.
    assert speeds == pytest.approx([1004], abs=5)
    assert 2 / SPEED_OF_LIGHT * speeds[0] == pytest.approx(6.7e-6, abs=0.1e-6)
    assert (found[0].first_chirp, found[0].last_chirp) == (0, 101)
    middle_m = found[0].range_m + speeds[0] * ROADSIDE.frame.chirp_starts_s[51]
    assert middle_m == pytest.approx(27.4, abs=0.5)
    fold = 2 * ROADSIDE.frame.max_velocity_m_per_s
    assert abs((speeds[0] - 24) / fold - 15) < 0.1


@pytest.mark.parametrize("kind", Mitigation.members())
def test_clean_up_costs_the_car_less_than_a_decibel(real_data, kind):
    recording = opened(real_data / "awr1243_interference", CLEAN)
    samples, frame = samples_of(recording.cube), ROADSIDE.frame
    method = example(Mitigation.members()[kind])
    done = apply_mitigation(samples, frame, [method])

    noise = dc.Chain().map_noise(ROADSIDE)
    left = mitigation_noise_gain(
        (method,), frame.chirp, noise.range_transform, noise.doppler_transform
    )

    def car_db(numbers, left):
        power = dc.power_map(recording.cube.isel(frame=0).copy(data=numbers), ROADSIDE, dc.Chain())
        power = power.copy(data=equalise(power.values, left))
        near = power.sel(velocity=slice(-14.5, -11), range=slice(13.5, 15))
        return 10 * np.log10(near.max().item())

    # A canceller weakens it by 1.8 dB at -12.8 m/s, and the noise there as much.
    assert car_db(done.samples, left) == pytest.approx(car_db(samples, np.ones_like(left)), abs=1)
    (removed,) = done.removed
    if kind.startswith("interference"):
        # The first chirp, in which the receivers had not settled, and nothing else.
        assert removed.n_changed_chirps == 1
    else:
        # A roadside that stands still.
        assert removed.removed_power > removed.remaining_power
