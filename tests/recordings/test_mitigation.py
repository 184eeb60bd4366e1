"""Mitigation of real recordings: loss of the car's echo, and detection of the ghost."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.mitigation.apply import apply_mitigation
from dechirp.processing.mitigation.base import Mitigation
from dechirp.processing.mitigation.leakage_subtraction import LeakageSubtraction
from dechirp.processing.mitigation.noise_loss import equalise_map_noise, mitigation_noise_gain
from dechirp.processing.quality.synchronous_interference import find_ghost_track
from nightly import nightly_except
from recordings.real_recordings import RECORDINGS, ROADSIDE, open_real_recording

GHOST_FILE = "20181128-214451.bin"
CLEAN_FILE = "20180613-190347.bin"


def make_example(member):
    return LeakageSubtraction(max_range_m=3.0) if member is LeakageSubtraction else member()


def extract_samples(cube):
    kind = np.complex64 if np.iscomplexobj(cube) else np.float32
    return np.ascontiguousarray(cube.values[0], kind)


@pytest.mark.parametrize(
    ("folder", "name"),
    nightly_except(8, [(folder, name) for folder, names in RECORDINGS.items() for name in names]),
)
def test_ghost_is_found_in_its_recording_only(real_data, folder, name):
    recording = open_real_recording(real_data / folder, name)
    if not recording.sizes:
        return  # points, without samples
    tracks = []
    for index, cube in enumerate(recording.frames()):
        samples = extract_samples(cube)
        gaps = np.zeros(len(samples), bool)
        frame = recording.radar.frame.for_frame(index)
        tracks.append(find_ghost_track(samples, gaps, frame, float(abs(samples).max()) or 1.0))
    speeds = [track.velocity_m_per_s for track in tracks]

    if name != GHOST_FILE:
        assert np.isnan(speeds).all()
        return
    # The collection gives 27.4 m and +24 m/s, smeared over 2.2 m: 1,004 m/s move the ghost from
    # 25.5 m to 28.5 m in its 102 chirps, and are aliased to 24 m/s (ambiguity number 15).
    assert speeds == pytest.approx([1004], abs=5)
    assert 2 / SPEED_OF_LIGHT * speeds[0] == pytest.approx(6.7e-6, abs=0.1e-6)
    assert (tracks[0].first_chirp, tracks[0].last_chirp) == (0, 101)
    middle_m = tracks[0].range_m + speeds[0] * ROADSIDE.frame.chirp_starts_s[51]
    assert middle_m == pytest.approx(27.4, abs=0.5)
    velocity_span = 2 * ROADSIDE.frame.max_velocity_m_per_s
    assert abs((speeds[0] - 24) / velocity_span - 15) < 0.1


@pytest.mark.parametrize("kind", Mitigation.members())
def test_mitigation_changes_car_snr_by_less_than_1_db(real_data, kind):
    recording = open_real_recording(real_data / "awr1243_interference", CLEAN_FILE)
    samples, frame = extract_samples(recording.cube), ROADSIDE.frame
    method = make_example(Mitigation.members()[kind])
    result = apply_mitigation(samples, frame, [method])

    noise = dc.Chain().map_noise_statistics(ROADSIDE)
    noise_gain = mitigation_noise_gain(
        (method,), frame.chirp, noise.range_transform, noise.doppler_transform
    )

    def car_db(cube_samples, noise_gain):
        power = dc.power_map(
            recording.cube.isel(frame=0).copy(data=cube_samples), ROADSIDE, dc.Chain()
        )
        power = power.copy(data=equalise_map_noise(power.values, noise_gain))
        car_cells = power.sel(velocity=slice(-14.5, -11), range=slice(13.5, 15))
        return 10 * np.log10(car_cells.max().item())

    # A canceller attenuates echo and noise at -12.8 m/s alike, by 1.8 dB.
    assert car_db(result.samples, noise_gain) == pytest.approx(
        car_db(samples, np.ones_like(noise_gain)), abs=1
    )
    (removed_echo,) = result.removed
    if kind.startswith("interference"):
        # Only the first chirp, in which the receivers had not settled; the frame is too long for
        # the repair of single chirps.
        assert removed_echo.n_changed_chirps == (0 if kind == "interference-tones" else 1)
    else:
        # The static roadside dominates.
        assert removed_echo.removed_power > removed_echo.remaining_power
