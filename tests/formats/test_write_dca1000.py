"""Writer of DCA1000 captures: round trips, foreign readers, settings files and sidecars."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.experiments.run import run
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.radar.cube import label_cube
from dechirp.radar.devices.lookup import device
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.recordings.convert import write
from dechirp.recordings.in_memory import recording_from_cube
from dechirp.recordings.samples.layouts import FourLanes, Pairs, SampleCode, TwoLanes
from dechirp.recordings.settings.read import read_settings
from formats.corruption import assert_cube_or_error, corrupted_bytes

SUFFIXES = (".bin", ".cfg", ".mmwave.json", ".setup.json", ".dechirp.json")


def make_chirp(**changes) -> dc.Chirp:
    settings = {
        "start_frequency_hz": 77e9,
        "slope_hz_per_s": 40e12,
        "adc_start_s": 6e-6,
        "ramp_duration_s": 40e-6,
        "sample_rate_hz": 4e6,
        "n_samples": 128,
        "sampling": "complex",
    }
    return dc.Chirp(**(settings | changes))


def make_radar(
    kind="xwr1843", *, n_chirps=32, tx_mask=0b111, rx_mask=0b1111, **changes
) -> dc.Radar:
    """Make a TDM radar that the demo of the board supports."""
    order = tuple(range(tx_mask.bit_count()))
    return dc.Radar(
        frame=dc.Frame(
            chirp=make_chirp(**changes),
            n_chirps=n_chirps,
            interval_s=60e-6,
            period_s=20e-3,
            multiplexing=Tdm(order=order) if len(order) > 1 else None,
        ),
        array=device(kind).select_antennas(tx_mask, rx_mask),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


CAR = dc.Target(position_m=(12.0, 2.0, 0.0), velocity_m_per_s=(-2.0, 0.0, 0.0), rcs_m2=10.0)


def simulate_car(radar: dc.Radar, *, n_frames=2, impairments=None) -> tuple[xr.DataArray, dict]:
    """Simulate the cube of a car, and return it with tables of truth and detections."""
    options = {} if impairments is None else {"impairments": impairments}
    scenario = Scenario(
        name="car", seed=3, radar=radar, scene=dc.Scene(targets=[CAR]), n_frames=n_frames, **options
    )
    result = run(scenario)
    return result.cube, {"truth": result.truth, "detections": result.detections}


def draw_codes(radar: dc.Radar, *, n_frames=2, seed=1, bits=16) -> np.ndarray:
    frame = radar.frame
    part_axis = (2,) if frame.chirp.sampling == "complex" else ()
    shape = (n_frames, frame.n_chirps_total, radar.array.n_rx, frame.chirp.n_samples, *part_axis)
    half_scale = 2 ** (bits - 1)
    return np.random.default_rng(seed).integers(-half_scale, half_scale, shape).astype(np.int16)


def make_cube(codes: np.ndarray, radar: dc.Radar, scale=2.0**-15, **attributes) -> xr.DataArray:
    """Make a cube of codes with their scale."""
    parts = codes.astype(np.float32) * np.float32(scale)
    is_complex = radar.frame.chirp.sampling == "complex"
    samples = parts.view(np.complex64)[..., 0] if is_complex else parts
    cube = label_cube(samples, radar, units="1")
    cube.attrs.update(scale=scale, **attributes)
    return cube


def make_recording(radar: dc.Radar, **options) -> dc.Recording:
    return recording_from_cube(make_cube(draw_codes(radar, **options), radar), radar)


@pytest.fixture(scope="module")
def mimo() -> tuple[dc.Radar, xr.DataArray, dict]:
    """Simulate three transmitters, four receivers and a 14-bit converter."""
    radar = make_radar()
    impairments = (
        dc.impairments.ThermalNoise(),
        dc.impairments.Quantisation(bits=14, full_scale_w=1e-8),
    )
    return (radar, *simulate_car(radar, impairments=impairments))


LAYOUTS = st.one_of(
    st.just(TwoLanes()),
    st.sets(st.integers(0, 3), min_size=1).map(
        lambda lanes: FourLanes(receivers=tuple(sorted(lanes)))
    ),
    st.sets(st.integers(0, 3), min_size=1).map(
        lambda places: Pairs(receivers=tuple(sorted(places)), n_present=4)
    ),
)


@given(
    layout=LAYOUTS,
    n_samples=st.integers(2, 9),
    n_chirps=st.integers(1, 3),
    n_rx=st.integers(1, 4),
    is_complex=st.booleans(),
    iq=st.sampled_from(["iq", "qi"]),
    bits=st.sampled_from([12, 14, 16]),
    offset_binary=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_layout_decodes_encoded_codes(
    layout, n_samples, n_chirps, n_rx, is_complex, iq, bits, offset_binary, seed
):
    if layout == TwoLanes():
        n_samples += n_samples % 2 if is_complex else 0
    else:
        n_rx = len(layout.receivers)
    code = SampleCode(bits=bits, offset_binary=offset_binary, iq=iq)
    half_scale = 2 ** (bits - 1)
    shape = (n_chirps, n_rx, n_samples, *((2,) if is_complex else ()))
    numbers = np.random.default_rng(seed).integers(-half_scale, half_scale, shape).astype(np.int16)

    words = layout.encode(numbers, code)

    chirp = make_chirp(n_samples=n_samples, sampling="complex" if is_complex else "real")
    assert words.shape == (n_chirps, layout.words_per_chirp(chirp, n_rx))
    decoded_samples = np.empty(
        (n_chirps, n_rx, n_samples), np.complex64 if is_complex else np.float32
    )
    layout.decode(words.copy(), decoded_samples, code)
    np.testing.assert_array_equal(
        decoded_samples.view(np.float32).ravel() / code.step_relative_to_full_scale, numbers.ravel()
    )


def test_simulated_capture_round_trip_is_bit_exact(tmp_path, mimo):
    radar, cube, tables = mimo

    paths = write(recording_from_cube(cube, radar, tables=tables), tmp_path / "x.bin")

    assert [path.name for path in paths] == [f"x{ending}" for ending in SUFFIXES]
    copy = dc.open(tmp_path / "x.bin")
    assert copy.format == "dca1000"
    assert copy.radar == radar
    np.testing.assert_array_equal(copy.cube.values, cube.values)
    assert copy.cube.attrs["units"] == "W**0.5"
    assert copy.cube.attrs["scale"] == cube.attrs["scale"]
    assert {name: table.identical(tables[name]) for name, table in copy.tables.items()} == {
        "truth": True,
        "detections": True,
    }
    assert copy.findings == ()


def test_rewritten_capture_has_equal_bytes(tmp_path):
    first_file = write(make_recording(make_radar()), tmp_path / "a.bin")[0]

    second_file = write(dc.open(first_file), tmp_path / "b.bin")[0]

    assert second_file.read_bytes() == first_file.read_bytes()


@pytest.mark.parametrize("without_sidecar", [False, True], ids=["with-sidecar", "ti-settings-only"])
def test_run_detects_car_in_written_capture(tmp_path, mimo, without_sidecar):
    radar, cube, tables = mimo
    write(recording_from_cube(cube, radar, tables=tables), tmp_path / "x.bin")
    if without_sidecar:
        (tmp_path / "x.dechirp.json").unlink()

    detections = run(
        Scenario(name="x", recording=RecordingSource(path=str(tmp_path / "x.bin")))
    ).detections

    truth = tables["truth"].isel(target=0, frame=0)
    strongest = detections.where(detections.frame == 0, drop=True)
    strongest = strongest.isel(detection=np.argmax(strongest.snr.values))
    assert abs(strongest.range - truth.range) < radar.frame.chirp.range_resolution_m
    assert abs(strongest.velocity - truth.velocity) < radar.frame.velocity_resolution_m_per_s
    assert abs(np.rad2deg(strongest.azimuth - truth.azimuth)) < 2


@pytest.mark.parametrize("without_sidecar", [False, True], ids=["with-sidecar", "ti-settings-only"])
def test_run_detects_car_in_written_real_samples(tmp_path, without_sidecar):
    radar = make_radar(tx_mask=0b1, sampling="real", n_samples=256, sample_rate_hz=8e6)
    cube, tables = simulate_car(radar)
    paths = write(recording_from_cube(cube, radar, tables=tables), tmp_path / "x.bin")
    assert "x.cfg" not in [path.name for path in paths]  # the demo does not support real samples
    if without_sidecar:
        (tmp_path / "x.dechirp.json").unlink()

    detections = run(
        Scenario(name="x", recording=RecordingSource(path=str(tmp_path / "x.bin")))
    ).detections

    truth = tables["truth"].isel(target=0, frame=0)
    strongest = detections.isel(detection=np.argmax(detections.snr.values))
    assert abs(strongest.range - truth.range) < radar.frame.chirp.range_resolution_m
    assert abs(strongest.velocity - truth.velocity) < radar.frame.velocity_resolution_m_per_s


STARTS_HZ = {"xwr6843": 60.3e9}
ANTENNA_MASKS = [("xwr1843", 0b101, 0b0110), ("xwr6843", 0b111, 0b1111), ("xwr1642", 0b11, 0b1110)]


@pytest.mark.parametrize(
    ("kind", "tx_mask", "rx_mask"), [*ANTENNA_MASKS, ("xwr1443", 0b100, 0b1010)]
)
@pytest.mark.parametrize("iq", ["iq", "qi"])
def test_all_settings_files_give_equal_radar_and_layout(tmp_path, kind, tx_mask, rx_mask, iq):
    start_hz = STARTS_HZ.get(kind, 77.1234567e9)
    radar = make_radar(kind, tx_mask=tx_mask, rx_mask=rx_mask, start_frequency_hz=start_hz)
    recording = make_recording(radar)
    contents = replace(recording.contents, device=kind, iq=iq)
    write(replace(recording, contents=contents), tmp_path / "x.bin")

    cfg, studio = (read_settings(tmp_path / name) for name in ("x.cfg", "x.setup.json"))

    assert replace(cfg, path=None) == replace(studio, path=None)
    assert cfg.radar.array == radar.array
    assert (cfg.device, cfg.iq, cfg.n_frames) == (kind, iq, 2)
    (tmp_path / "x.dechirp.json").unlink()
    copy = dc.open(tmp_path / "x.bin", format="dca1000")
    assert copy.contents.settings_path == tmp_path / "x.cfg"
    np.testing.assert_array_equal(copy.cube.values, recording.cube.values)


def test_rejects_contradictory_settings_files(tmp_path):
    write(make_recording(make_radar()), tmp_path / "x.bin")
    (tmp_path / "x.dechirp.json").unlink()
    text = (tmp_path / "x.cfg").read_text()
    (tmp_path / "x.cfg").write_text(text.replace("profileCfg 0 77 ", "profileCfg 0 77.5 "))

    with pytest.raises(RecordingError, match=r"in the folder x\.cfg, x\.setup\.json"):
        dc.open(tmp_path / "x.bin")


def test_openradar_reads_two_lane_capture(tmp_path):
    adc = pytest.importorskip("mmwave.dataloader.adc")
    radar = make_radar()
    numbers = draw_codes(radar)
    write(recording_from_cube(make_cube(numbers, radar), radar), tmp_path / "x.bin")

    words = np.fromfile(tmp_path / "x.bin", np.int16).reshape(len(numbers), -1)

    for frame, expected in zip(words, numbers, strict=True):
        samples = adc.DCA1000.organize(
            frame, radar.frame.n_chirps_total, 4, radar.frame.chirp.n_samples
        )
        np.testing.assert_array_equal(samples, expected[..., 0] + 1j * expected[..., 1])


def test_ti_script_reads_two_lane_capture(tmp_path):
    # SWRA581, for xWR16xx: fileSize / 2 complex numbers, each pair of four words.
    radar = make_radar(rx_mask=0b0111)
    numbers = draw_codes(radar)
    write(recording_from_cube(make_cube(numbers, radar), radar), tmp_path / "x.bin")

    adc = np.fromfile(tmp_path / "x.bin", "<i2").astype(float)
    lvds = np.zeros(adc.size // 2, complex)
    lvds[0::2] = adc[0::4] + 1j * adc[2::4]
    lvds[1::2] = adc[1::4] + 1j * adc[3::4]
    chirp_samples = lvds.reshape(-1, 3 * radar.frame.chirp.n_samples)

    expected = (numbers[..., 0] + 1j * numbers[..., 1]).reshape(chirp_samples.shape)
    np.testing.assert_array_equal(chirp_samples, expected)


def test_ti_script_reads_four_lane_capture(tmp_path):
    # SWRA581, for xWR14xx: 8 words per sample, 4 real parts, then 4 imaginary ones. An odd
    # number of samples is possible only on this chip, which has no groups of two.
    radar = make_radar("xwr1443", n_samples=127)
    numbers = draw_codes(radar)
    write(recording_from_cube(make_cube(numbers, radar), radar), tmp_path / "x.bin")

    adc = np.fromfile(tmp_path / "x.bin", "<i2").reshape(-1, 8).astype(float)
    lane_samples = (adc[:, :4] + 1j * adc[:, 4:]).T

    expected = np.moveaxis(numbers[..., 0] + 1j * numbers[..., 1], 2, 0).reshape(4, -1)
    np.testing.assert_array_equal(lane_samples, expected)
    assert json.loads((tmp_path / "x.mmwave.json").read_text())["mmWaveDevices"][0][
        "rawDataCaptureConfig"
    ]["rlDevLaneEnable_t"] == {"laneEn": "0xf"}


@given(
    exponent=st.integers(-60, 20),
    largest=st.floats(1.0, 2.0, exclude_max=True, width=32),
    seed=st.integers(0, 2**32 - 1),
)
def test_float_samples_are_rounded_within_half_smallest_step(
    tmp_path_factory, exponent, largest, seed
):
    radar = make_radar(n_chirps=1, tx_mask=0b1, rx_mask=0b1, n_samples=8)
    rng = np.random.default_rng(seed)
    samples = rng.uniform(-1, 1, (2, 1, 1, 8, 2)).astype(np.float32)
    samples.flat[rng.integers(samples.size)] = largest
    samples *= np.float32(2.0**exponent)
    cube = label_cube(samples.view(np.complex64)[..., 0], radar, units="W**0.5")
    file = tmp_path_factory.mktemp("rounded") / "x.bin"

    write(recording_from_cube(cube, radar), file)

    copy = dc.open(file).cube
    step, words = copy.attrs["scale"], np.fromfile(file, "<i2").astype(int)
    assert np.abs(copy.values.view(np.float32) - cube.values.view(np.float32)).max() <= step / 2
    assert np.log2(step) % 1 == 0
    assert 2**14 - 1 <= np.abs(words).max() < 2**15
    (finding,) = [candidate for candidate in dc.open(file).findings if candidate.setting == "scale"]
    assert f"rounded to steps of {step:.6g} W**0.5" in finding.value


def test_codes_beyond_16_bits_are_rounded_without_wrapping(tmp_path):
    radar = make_radar()
    cube = make_cube(draw_codes(radar), radar)
    fine_cube = cube.assign_attrs(scale=2.0**-17)

    write(recording_from_cube(fine_cube, radar), tmp_path / "x.bin")

    np.testing.assert_array_equal(dc.open(tmp_path / "x.bin").cube.values, cube.values)


def test_12_bit_codes_keep_full_scale_without_sidecar(tmp_path):
    radar = make_radar()
    cube = make_cube(draw_codes(radar, bits=12), radar, scale=2.0**-11)
    write(recording_from_cube(cube, radar), tmp_path / "x.bin")
    (tmp_path / "x.dechirp.json").unlink()

    copy = dc.open(tmp_path / "x.bin")

    np.testing.assert_array_equal(copy.cube.values, cube.values)
    assert copy.cube.attrs["scale"] == 2.0**-11


def test_round_trip_keeps_gaps(tmp_path):
    radar = make_radar()
    cube = make_cube(draw_codes(radar), radar)
    gaps = np.random.default_rng(2).random(cube.shape[:2]) < 0.1
    cube.values[gaps] = 0
    cube = cube.assign_coords(gap=(("frame", "chirp"), gaps))

    write(recording_from_cube(cube, radar), tmp_path / "x.bin")

    copy = dc.open(tmp_path / "x.bin")
    np.testing.assert_array_equal(copy.cube.gap.values, gaps)
    np.testing.assert_array_equal(next(copy.select_frames(1, 2).frames()).gap.values[0], gaps[1])


def test_round_trip_keeps_calibration(tmp_path):
    radar = make_radar()
    elements = tuple((tx, rx) for tx in range(3) for rx in range(4))
    gain = tuple((1.0, 0.01 * n) for n in range(12))
    calibrated_radar = replace(radar, calibration=dc.Calibration(elements=elements, gain=gain))

    write(
        recording_from_cube(make_cube(draw_codes(radar), radar), calibrated_radar),
        tmp_path / "x.bin",
    )

    assert dc.open(tmp_path / "x.bin").radar == calibrated_radar


def test_given_radar_takes_precedence_over_file(tmp_path):
    radar = make_radar()
    write(make_recording(radar), tmp_path / "x.bin")
    given_radar = replace(radar, frame=replace(radar.frame, interval_s=70e-6))

    assert dc.open(tmp_path / "x.bin", radar=given_radar).radar == given_radar


def test_truncated_capture_gives_complete_frames(tmp_path):
    recording = make_recording(make_radar(), n_frames=3)
    (file, *_) = write(recording, tmp_path / "x.bin")
    file.write_bytes(file.read_bytes()[:-8])

    copy = dc.open(file)

    assert copy.n_frames == 2
    assert "cut short" in str(copy.findings)
    np.testing.assert_array_equal(copy.cube.values, recording.cube.values[:2])


ARRAY_OF_FIVE = dc.Array(rx_m=tuple((0.0, 0.002 * n, 0.0) for n in range(5)))
SINGLE_TX_RADAR = make_radar(tx_mask=0b1)
SLOW_FRAME = dc.Frame(
    chirp=make_chirp(sample_rate_hz=44.1e3, ramp_duration_s=20e-3), n_chirps=4, interval_s=30e-3
)


@pytest.mark.parametrize(
    ("radar", "message"),
    [
        (replace(SINGLE_TX_RADAR, array=ARRAY_OF_FIVE), "5 antennas.*at most 4.*4 lanes"),
        (
            replace(
                SINGLE_TX_RADAR, frame=replace(SINGLE_TX_RADAR.frame, interval_s=(60e-6, 70e-6))
            ),
            "a list of 2",
        ),
        (
            replace(
                SINGLE_TX_RADAR,
                frame=replace(
                    SINGLE_TX_RADAR.frame, modulation=dc.modulations.Triangular(), interval_s=90e-6
                ),
            ),
            "ramps that differ",
        ),
        (
            replace(
                make_radar(tx_mask=0b11),
                frame=replace(
                    SINGLE_TX_RADAR.frame,
                    multiplexing=dc.multiplexing.Tdm(order=(0, 1), pause_s=1e-4),
                ),
            ),
            "a pause of 100 us after each round",
        ),
        (
            replace(
                make_radar(tx_mask=0b11),
                frame=replace(SINGLE_TX_RADAR.frame, multiplexing=Bpm(order=(0, 1))),
            ),
            "several transmitters in a chirp",
        ),
        (replace(SINGLE_TX_RADAR, frame=SLOW_FRAME), "rate in steps of 1 kS/s"),
    ],
    ids=[
        "five-receivers",
        "unequal-intervals",
        "triangular-ramps",
        "pause",
        "bpm",
        "low-sample-rate",
    ],
)
def test_rejects_radar_without_ti_equivalent(tmp_path, radar, message):
    with pytest.raises(DechirpError, match=message):
        write(make_recording(radar), tmp_path / "x.bin")
    assert list(tmp_path.iterdir()) == []


def test_rejects_odd_sample_count_for_two_lanes(tmp_path):
    recording = make_recording(make_radar(n_samples=127))
    recording_1642 = replace(recording, contents=replace(recording.contents, device="xwr1642"))

    with pytest.raises(DechirpError, match="127 complex samples.*groups of two"):
        write(recording_1642, tmp_path / "x.bin")


def test_rejects_non_finite_samples(tmp_path):
    radar = make_radar()
    cube = make_cube(draw_codes(radar), radar)
    cube.values[1, 2, 3, 4] = np.nan

    with pytest.raises(DechirpError, match="non-finite"):
        write(recording_from_cube(cube, radar), tmp_path / "x.bin")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["x.cfg", "x.mmwave.json", "x.dechirp.json"])
def test_foreign_settings_are_not_overwritten(tmp_path, name):
    (tmp_path / name).write_text("of a real capture")

    with pytest.raises(DechirpError, match=name):
        write(make_recording(make_radar()), tmp_path / "x.bin")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [
        (name, "of a real capture")
    ]


def test_replaces_native_capture_with_all_its_files(tmp_path):
    write(make_recording(make_radar()), tmp_path / "x.bin")
    custom_radar = replace(
        make_radar(tx_mask=0b1), array=dc.Array(rx_m=((0.0, 0.0, 0.0), (0.0, 0.1, 0.0)))
    )

    paths = write(make_recording(custom_radar), tmp_path / "x.bin")

    assert {path.name for path in paths} == {"x.bin", "x.mmwave.json", "x.dechirp.json"}
    assert set(tmp_path.iterdir()) == set(paths)
    copy = dc.open(tmp_path / "x.bin")
    assert copy.radar == custom_radar
    assert "not written: Radar.array.rx_m: positions that differ" in str(copy.findings)


@pytest.mark.parametrize("ending", [".mmwave.json", ".dechirp.json"])
def test_full_disk_at_rename_keeps_existing_capture(tmp_path, monkeypatch, ending):
    write(make_recording(make_radar()), tmp_path / "x.bin")
    contents = {path: path.read_bytes() for path in tmp_path.iterdir()}
    rename = Path.rename

    def rename_on_full_disk(self, target):
        is_new = not self.name.endswith(".before")
        if is_new and Path(target).name == f"x{ending}":
            raise OSError(28, "No space left on device")
        return rename(self, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", rename_on_full_disk)
        with pytest.raises(DechirpError, match="No space left"):
            write(make_recording(make_radar(), seed=5), tmp_path / "x.bin")

    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == contents


def test_full_disk_during_samples_keeps_existing_capture(tmp_path):
    write(make_recording(make_radar()), tmp_path / "x.bin")
    contents = {path: path.read_bytes() for path in tmp_path.iterdir()}

    def raise_disk_full(n_frames, n_total):
        raise OSError(28, "No space left on device")

    with pytest.raises(DechirpError, match="No space left"):
        write(make_recording(make_radar(), seed=5), tmp_path / "x.bin", progress=raise_disk_full)

    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == contents


def test_rejects_other_suffix(tmp_path):
    with pytest.raises(DechirpError, match=r"ends in \.bin"):
        write(make_recording(make_radar()), tmp_path / "x.cfg", format="dca1000")


SMALL_RADAR = make_radar(n_chirps=1, tx_mask=0b1, rx_mask=0b1, n_samples=8)


@pytest.fixture(scope="module")
def capture_path(tmp_path_factory) -> Path:
    """Write a small capture with a table and lost chirps."""
    folder = tmp_path_factory.mktemp("kept")
    cube = make_cube(draw_codes(SMALL_RADAR), SMALL_RADAR).assign_coords(
        gap=(("frame", "chirp"), [[True], [False]])
    )
    table = xr.Dataset({"label": ("target", ["car", "a van"]), "rcs": ("target", [1.0, np.nan])})
    write(recording_from_cube(cube, SMALL_RADAR, tables={"truth": table}), folder / "x.bin")
    return folder / "x.bin"


@given(data=st.data())
def test_corrupted_sidecar_gives_cube_or_error(capture_path, data):
    file = capture_path.with_suffix(".dechirp.json")
    content = file.read_bytes()
    try:
        file.write_bytes(data.draw(corrupted_bytes(content)))
        assert_cube_or_error(capture_path)
    finally:
        file.write_bytes(content)


LAYOUT = {"device": None, "lanes": 2, "receivers": [0], "iq": "iq", "n_frames": 2}
INVALID_SIDECARS = {
    "objects": {"gap": {"dtype": "object", "shape": [2, 1], "values": [{}, {}]}},
    "values missing": {"gap": {"dtype": "bool", "shape": [2, 10**12], "values": []}},
    "gaps of other frames": {"gap": {"dtype": "bool", "shape": [3, 1], "values": [0, 0, 0]}},
    "gaps of other chirps": {"gap": {"dtype": "bool", "shape": [2, 2], "values": [0, 0, 0, 0]}},
    "beyond a byte": {"gap": {"dtype": "uint8", "shape": [2, 1], "values": [300, 0]}},
    "lanes": {"layout": {"device": None, "lanes": 3, "receivers": [0], "iq": "iq", "n_frames": 2}},
    "receiver": {
        "layout": {"device": None, "lanes": 4, "receivers": [9], "iq": "iq", "n_frames": 2}
    },
    "scale": {"scale": 1e300},
    "no scale": {"scale": None},
    "version": {"dechirp_exchange": 99},
    "no columns": {"columns": {}},
    "findings": {
        "findings": [{"level": "fatal", "setting": "", "value": "", "expected": "", "fix": ""}]
    },
}


@pytest.mark.parametrize("changes", INVALID_SIDECARS.values(), ids=INVALID_SIDECARS)
def test_rejects_invalid_sidecar(capture_path, tmp_path, changes):
    for ending in (".bin", ".dechirp.json"):
        (tmp_path / f"x{ending}").write_bytes(capture_path.with_suffix(ending).read_bytes())
    file = tmp_path / "x.dechirp.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))

    with pytest.raises(RecordingError):
        dc.open(tmp_path / "x.bin")


def test_rejects_sidecar_with_million_lists(capture_path, tmp_path):
    (tmp_path / "x.bin").write_bytes(capture_path.read_bytes())
    text = capture_path.with_suffix(".dechirp.json").read_text()
    (tmp_path / "x.dechirp.json").write_text(text[:-3] + ', "more": [' + "[]," * 2**20 + "0]}")

    with pytest.raises(RecordingError, match="objects and lists"):
        dc.open(tmp_path / "x.bin")


def test_ignores_sidecar_behind_link(capture_path, tmp_path):
    (tmp_path / "x.bin").write_bytes(capture_path.read_bytes())
    (tmp_path / "x.dechirp.json").symlink_to(capture_path.with_suffix(".dechirp.json"))

    with pytest.raises(RecordingError, match="no settings"):
        dc.open(tmp_path / "x.bin")


def test_round_trip_keeps_texts_and_nan_of_table(capture_path):
    (table,) = dc.open(capture_path).tables.values()

    assert list(table.label.values) == ["car", "a van"]
    assert struct.pack("<2d", *table.rcs.values) == struct.pack("<2d", 1.0, np.nan)


def test_frames_decoded_at_once_are_those_decoded_one_by_one(tmp_path):
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=30e12,
        ramp_duration_s=30e-6,
        sample_rate_hz=10e6,
        n_samples=16,
        sampling="complex",
    )
    radar = dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=4, interval_s=40e-6),
        array=dc.Array(rx_m=((0, 0, 0), (0, 0.002, 0))),
    )
    words = np.random.default_rng(1).integers(-2000, 2000, 7 * 4 * 2 * 16 * 2, dtype=np.int16)
    words.tofile(tmp_path / "adc.bin")
    options = {"radar": radar, "device": "xwr1642", "iq": "iq", "format": "dca1000"}
    recording = dc.open(tmp_path / "adc.bin", **options)
    second = dc.open(tmp_path / "adc.bin", frames=(2, 6), **options).select_receivers([1])
    assert recording.contents.decode_frames is not None
    one_by_one = np.concatenate([frame.values for frame in recording.frames()])
    assert np.array_equal(recording.cube.values, one_by_one)
    assert np.array_equal(second.cube.values, one_by_one[2:6, :, [1]])
