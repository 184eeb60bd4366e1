"""Calterah text: samples, choice of the profile, recognised Doppler division, damaged files."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.radar.multiplexing.ddma import Ddma
from dechirp.recordings.readers import calterah
from small_radars import HALF_WAVELENGTH_M

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")

SETTINGS = """\
/*
 * @Author: your name
 */
    .fmcw_startfreq = 76.5,
    .fmcw_bandwidth = 600,
    .fmcw_chirp_rampup = {ramp_us},
    .fmcw_chirp_period = {period_us},
    .tx_groups = {{0x0001, 0x0000}},
    .nchirp = {n_chirps},
    .adc_freq = 20,
    .dec_factor = 2,
    .adc_sample_start = 2,
    .rng_nfft = {n_samples},
    .rng_win = "hanning",
    .ant_pos = {{{positions}}},
    .sv_read_from_flash = false,
"""
POSITIONS = ", ".join(f"{{{2.0 * tx + 0.5 * rx}, 0}}" for tx in range(3) for rx in range(4))
PROFILES = {  # of equal length in samples
    0: {"ramp_us": 16.5, "period_us": 20, "n_chirps": 128, "n_samples": 128},
    1: {"ramp_us": 29.5, "period_us": 33, "n_chirps": 64, "n_samples": 256},
}
SUB_BANDS = (5, 0, 1)


def settings_text(profile: int) -> str:
    return SETTINGS.format(positions=POSITIONS, **PROFILES[profile])


def write_samples(path, codes) -> None:
    """Write int16 samples (sample) as words with the first sample in the high half."""
    words = codes.astype(np.uint16).astype(np.uint32).reshape(-1, 2)
    numbers = (words[:, 0] << 16) | words[:, 1]
    path.write_text(",".join(map(str, numbers.tolist())) + ",0")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return a folder with Doppler division of profile 1, and its samples (rx, chirp, sample)."""
    folder = tmp_path_factory.mktemp("calterah")
    for profile in PROFILES:
        (folder / f"sensor_config_init{profile}.hxx").write_text(settings_text(profile))
    chirp = dc.Chirp(
        start_frequency_hz=76.5e9,
        slope_hz_per_s=600e6 / 29.5e-6,
        ramp_duration_s=29.5e-6,
        adc_start_s=2e-6,
        sample_rate_hz=10e6,
        n_samples=256,
        sampling="real",
    )
    array = dc.Array(
        tx_m=tuple((0.0, 2.0 * tx * chirp.wavelength_m, 0.0) for tx in range(3)),
        rx_m=tuple((0.0, 0.5 * rx * chirp.wavelength_m, 0.0) for rx in range(4)),
    )
    code = Ddma(order=(0, 1, 2), n_sub_bands=8, sub_bands=SUB_BANDS)
    radar = dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=8, interval_s=33e-6, multiplexing=code),
        array=array,
        hardware=dc.Hardware(transmit_power_w=0.05, antenna_gain=30.0, noise_factor=10.0),
    )
    targets = [
        dc.Target(position_m=(x, y, 0.0), rcs_m2=3.0)
        for x, y in ((6.0, 1.0), (10.0, -3.0), (14.0, 6.0), (19.0, 0.5))
    ]
    samples = dc.simulate(dc.Scene(targets=targets), radar, seed=2).values[0]
    codes = np.round(samples * (8000 / np.abs(samples).max())).astype(np.int16)
    for rx in range(4):
        write_samples(folder / f"yard_rx{rx}.txt", codes[:, rx].ravel())
    return folder, codes


def test_samples_profile_and_code_are_read_without_options(recording):
    folder, codes = recording
    opened = dc.open(folder)
    assert opened.n_frames == 1
    (frame,) = opened.frames()
    np.testing.assert_array_equal(frame.values.squeeze(), (codes / 2**15).astype(np.float32))
    assert opened.radar.frame.chirp.n_samples == 256
    code = opened.radar.frame.multiplexing
    assert dict(zip(code.order, code.sub_bands, strict=True)) == dict(enumerate(SUB_BANDS))
    assert code.n_sub_bands == 8
    np.testing.assert_allclose(
        np.array(opened.radar.array.rx_m)[:, 1], HALF_WAVELENGTH_M * np.arange(4), rtol=0.02
    )
    texts = " ".join(str(finding) for finding in opened.findings)
    assert "sensor_config_init1.hxx" in texts
    assert "sub-bands 0, 1, 5 of 8, in the order of the array" in texts


def test_name_and_given_radar_choose_the_profile(recording, tmp_path):
    folder, codes = recording
    for name in ("sensor_config_init0.hxx", "sensor_config_init1.hxx"):
        (tmp_path / name).write_text((folder / name).read_text())
    file = tmp_path / "adc_Pf0_Rx2.txt"
    write_samples(file, codes[:, 2].ravel())
    assert dc.open(tmp_path).radar.frame.chirp.n_samples == 128
    assert dc.open(file).radar.array.n_rx == 1
    radar = dc.open(folder).radar
    with pytest.raises(RecordingError, match="1 receivers"):
        dc.open(file, radar=radar)


def test_profiles_of_equal_layout_are_compared_once(recording, monkeypatch):
    folder, _ = recording
    (folder / "sensor_config_init2.hxx").write_text(settings_text(1))
    shapes = []

    def count_shape(codes, *shape):
        shapes.append(shape)
        return measure(codes, *shape)

    measure = calterah._echo_concentration
    monkeypatch.setattr(calterah, "_echo_concentration", count_shape)
    try:
        opened = dc.open(folder)
    finally:
        (folder / "sensor_config_init2.hxx").unlink()

    assert sorted(shapes) == [(64, 256), (128, 128)]
    assert "sensor_config_init2.hxx would read the same samples" in opened.findings[0].value


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text + ",x", "among numbers"),
        (lambda text: text + ",99999999999", "11 digits"),
        (lambda text: text + ",4294967296", "4294967296"),
        (lambda text: text + ",00000000001", "11 digits"),
        (lambda text: text.replace(",0", ",04294967295,0"), "11 digits"),
        (lambda text: text + "," + 30 * "9", "11 digits"),  # beyond 64 bits
        (lambda text: text[:2000], "numbers"),
        (lambda _: "", "no recording"),
    ],
)
def test_damaged_text_is_one_clear_error(change, message, recording, tmp_path):
    folder, _ = recording
    (tmp_path / "sensor_config_init1.hxx").write_text(settings_text(1))
    (tmp_path / "yard_rx0.txt").write_text(change((folder / "yard_rx0.txt").read_text()))
    with pytest.raises(DechirpError, match=message):
        dc.open(tmp_path)


def test_several_recordings_in_a_folder_are_refused(recording, tmp_path):
    folder, _ = recording
    (tmp_path / "sensor_config_init1.hxx").write_text(settings_text(1))
    for name in ("a_rx0.txt", "b_rx0.txt"):
        (tmp_path / name).write_text((folder / "yard_rx0.txt").read_text())
    with pytest.raises(RecordingError, match="several recordings"):
        dc.open(tmp_path)


@pytest.mark.parametrize("seed", range(40))
def test_mutated_settings_are_read_or_refused(seed, recording, tmp_path):
    folder, _ = recording
    rng = np.random.default_rng(seed)
    content = bytearray(settings_text(1).encode())
    for position in rng.integers(len(content), size=3):
        content[position] = rng.choice(list(b"0123456789.,{}e-= \nx"))
    (tmp_path / "sensor_config_init1.hxx").write_bytes(content)
    (tmp_path / "yard_rx0.txt").write_text((folder / "yard_rx0.txt").read_text())
    try:
        opened = dc.open(tmp_path)
        assert all(np.isfinite(frame.values).all() for frame in opened.frames())
    except DechirpError as error:
        assert error.mistakes


def test_directions_are_unknown_where_the_transmit_order_is(recording, tmp_path):
    """Receivers recorded one after another: phases between them are random."""
    _, codes = recording
    (tmp_path / "sensor_config_init1.hxx").write_text(settings_text(1))
    for rx, shift in enumerate(
        (0, 5, 3, 7)
    ):  # chirps: each echo has another phase in each sub-band
        write_samples(tmp_path / f"yard_rx{rx}.txt", np.roll(codes[:, rx], shift, axis=0).ravel())
    opened = dc.open(tmp_path)
    assert not opened.radar.frame.multiplexing.is_order_known
    (finding,) = [item for item in opened.findings if "in unknown order" in item.value]
    assert finding.level == "warning" and "directions are left unknown" in finding.expected
    (cube,) = opened.frames()
    detections = dc.detect(cube, opened.radar)
    assert detections.sizes["detection"] >= 4
    for name in ("azimuth", "elevation", "azimuth_std", "elevation_std"):
        assert np.isnan(detections[name].values).all()
