"""A capture written as a DCA1000 writes it is read back by us, by others, and by TI's layout."""

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
from formats.any_bytes import damaged, gives_a_cube_or_says_why

ENDINGS = (".bin", ".cfg", ".mmwave.json", ".setup.json", ".dechirp.json")


def chirp(**changes) -> dc.Chirp:
    told = {
        "start_frequency_hz": 77e9,
        "slope_hz_per_s": 40e12,
        "adc_start_s": 6e-6,
        "ramp_duration_s": 40e-6,
        "sample_rate_hz": 4e6,
        "n_samples": 128,
        "sampling": "complex",
    }
    return dc.Chirp(**(told | changes))


def radar(kind="xwr1843", *, n_chirps=32, tx_mask=0b111, rx_mask=0b1111, **changes) -> dc.Radar:
    """Make a radar of transmitters in turn that the demo of the board can be told to be."""
    order = tuple(range(tx_mask.bit_count()))
    return dc.Radar(
        frame=dc.Frame(
            chirp=chirp(**changes),
            n_chirps=n_chirps,
            interval_s=60e-6,
            period_s=20e-3,
            multiplexing=Tdm(order=order) if len(order) > 1 else None,
        ),
        array=device(kind).select_antennas(tx_mask, rx_mask),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


CAR = dc.Target(position_m=(12.0, 2.0, 0.0), velocity_m_per_s=(-2.0, 0.0, 0.0), rcs_m2=10.0)


def simulated(of: dc.Radar, *, n_frames=2, impairments=None) -> tuple[xr.DataArray, dict]:
    """Cube of a car, and the truth as a table."""
    told = {} if impairments is None else {"impairments": impairments}
    scenario = Scenario(
        name="car", seed=3, radar=of, scene=dc.Scene(targets=[CAR]), n_frames=n_frames, **told
    )
    made = run(scenario)
    return made.cube, {"truth": made.truth, "detections": made.detections}


def any_codes(of: dc.Radar, *, n_frames=2, seed=1, bits=16) -> np.ndarray:
    frame = of.frame
    parts = (2,) if frame.chirp.sampling == "complex" else ()
    shape = (n_frames, frame.n_chirps_total, of.array.n_rx, frame.chirp.n_samples, *parts)
    half = 2 ** (bits - 1)
    return np.random.default_rng(seed).integers(-half, half, shape).astype(np.int16)


def cube_of(numbers: np.ndarray, of: dc.Radar, scale=2.0**-15, **attributes) -> xr.DataArray:
    """Cube of codes, with their scale."""
    parts = numbers.astype(np.float32) * np.float32(scale)
    is_complex = of.frame.chirp.sampling == "complex"
    samples = parts.view(np.complex64)[..., 0] if is_complex else parts
    cube = label_cube(samples, of, units="full scale")
    cube.attrs.update(scale=scale, **attributes)
    return cube


def coded(of: dc.Radar, **told) -> dc.Recording:
    return recording_from_cube(cube_of(any_codes(of, **told), of), of)


@pytest.fixture(scope="module")
def mimo() -> tuple[dc.Radar, xr.DataArray, dict]:
    """Three transmitters, four receivers, and a converter of 14 bits."""
    of = radar()
    impairments = (
        dc.impairments.ThermalNoise(),
        dc.impairments.Quantisation(bits=14, full_scale_w=1e-8),
    )
    return (of, *simulated(of, impairments=impairments))


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
def test_words_of_codes_are_decoded_to_the_codes_in_every_layout(
    layout, n_samples, n_chirps, n_rx, is_complex, iq, bits, offset_binary, seed
):
    if layout == TwoLanes():
        n_samples += n_samples % 2 if is_complex else 0
    else:
        n_rx = len(layout.receivers)
    code = SampleCode(bits=bits, offset_binary=offset_binary, iq=iq)
    half = 2 ** (bits - 1)
    shape = (n_chirps, n_rx, n_samples, *((2,) if is_complex else ()))
    numbers = np.random.default_rng(seed).integers(-half, half, shape).astype(np.int16)

    words = layout.encode(numbers, code)

    ramp = chirp(n_samples=n_samples, sampling="complex" if is_complex else "real")
    assert words.shape == (n_chirps, layout.chirp_words(ramp, n_rx))
    again = np.empty((n_chirps, n_rx, n_samples), np.complex64 if is_complex else np.float32)
    layout.decode(words.copy(), again, code)
    np.testing.assert_array_equal(again.view(np.float32).ravel() / code.scale, numbers.ravel())


def test_a_simulated_capture_comes_back_bit_by_bit_with_its_tables(tmp_path, mimo):
    of, cube, tables = mimo

    written = write(recording_from_cube(cube, of, tables=tables), tmp_path / "x.bin")

    assert [path.name for path in written] == [f"x{ending}" for ending in ENDINGS]
    back = dc.open(tmp_path / "x.bin")
    assert back.format == "dca1000"
    assert back.radar == of
    np.testing.assert_array_equal(back.cube.values, cube.values)
    assert back.cube.attrs["units"] == "sqrt(W)"
    assert back.cube.attrs["scale"] == cube.attrs["scale"]
    assert {name: table.identical(tables[name]) for name, table in back.tables.items()} == {
        "truth": True,
        "detections": True,
    }
    assert back.findings == ()


def test_codes_of_a_capture_are_written_as_the_bytes_they_were(tmp_path):
    first = write(coded(radar()), tmp_path / "a.bin")[0]

    second = write(dc.open(first), tmp_path / "b.bin")[0]

    assert second.read_bytes() == first.read_bytes()


@pytest.mark.parametrize("is_alone", [False, True], ids=["with ours", "with those of TI alone"])
def test_a_run_finds_the_car_in_what_was_written(tmp_path, mimo, is_alone):
    of, cube, tables = mimo
    write(recording_from_cube(cube, of, tables=tables), tmp_path / "x.bin")
    if is_alone:
        (tmp_path / "x.dechirp.json").unlink()

    found = run(
        Scenario(name="x", recording=RecordingSource(path=str(tmp_path / "x.bin")))
    ).detections

    truth = tables["truth"].isel(target=0, frame=0)
    strongest = found.where(found.frame == 0, drop=True)
    strongest = strongest.isel(detection=np.argmax(strongest.snr.values))
    assert abs(strongest.range - truth.range) < of.frame.chirp.range_resolution_m
    assert abs(strongest.velocity - truth.velocity) < of.frame.velocity_resolution_m_per_s
    assert abs(np.rad2deg(strongest.azimuth - truth.azimuth)) < 2


@pytest.mark.parametrize("is_alone", [False, True], ids=["with ours", "with those of TI alone"])
def test_a_run_finds_the_car_in_real_samples(tmp_path, is_alone):
    of = radar(tx_mask=0b1, sampling="real", n_samples=256, sample_rate_hz=8e6)
    cube, tables = simulated(of)
    written = write(recording_from_cube(cube, of, tables=tables), tmp_path / "x.bin")
    assert "x.cfg" not in [path.name for path in written]  # the demo takes no real samples
    if is_alone:
        (tmp_path / "x.dechirp.json").unlink()

    found = run(
        Scenario(name="x", recording=RecordingSource(path=str(tmp_path / "x.bin")))
    ).detections

    truth = tables["truth"].isel(target=0, frame=0)
    strongest = found.isel(detection=np.argmax(found.snr.values))
    assert abs(strongest.range - truth.range) < of.frame.chirp.range_resolution_m
    assert abs(strongest.velocity - truth.velocity) < of.frame.velocity_resolution_m_per_s


STARTS_HZ = {"xwr6843": 60.3e9}
PARTS = [("xwr1843", 0b101, 0b0110), ("xwr6843", 0b111, 0b1111), ("xwr1642", 0b11, 0b1110)]


@pytest.mark.parametrize(("kind", "tx_mask", "rx_mask"), [*PARTS, ("xwr1443", 0b100, 0b1010)])
@pytest.mark.parametrize("iq", ["iq", "qi"])
def test_all_files_of_settings_say_the_same_radar_and_layout(tmp_path, kind, tx_mask, rx_mask, iq):
    start_hz = STARTS_HZ.get(kind, 77.1234567e9)
    of = radar(kind, tx_mask=tx_mask, rx_mask=rx_mask, start_frequency_hz=start_hz)
    made = coded(of)
    told = replace(made.contents, device=kind, iq=iq)
    write(replace(made, contents=told), tmp_path / "x.bin")

    cfg, studio = (read_settings(tmp_path / name) for name in ("x.cfg", "x.setup.json"))

    assert replace(cfg, path=None) == replace(studio, path=None)
    assert cfg.radar.array == of.array
    assert (cfg.device, cfg.iq, cfg.n_frames) == (kind, iq, 2)
    (tmp_path / "x.dechirp.json").unlink()
    alone = dc.open(tmp_path / "x.bin", format="dca1000")
    assert alone.contents.settings_path == tmp_path / "x.cfg"
    np.testing.assert_array_equal(alone.cube.values, made.cube.values)


def test_two_files_that_differ_are_still_named_and_none_is_taken(tmp_path):
    write(coded(radar()), tmp_path / "x.bin")
    (tmp_path / "x.dechirp.json").unlink()
    text = (tmp_path / "x.cfg").read_text()
    (tmp_path / "x.cfg").write_text(text.replace("profileCfg 0 77 ", "profileCfg 0 77.5 "))

    with pytest.raises(RecordingError, match=r"in the folder x\.cfg, x\.setup\.json"):
        dc.open(tmp_path / "x.bin")


def test_openradar_reads_the_cube_of_two_lanes(tmp_path):
    adc = pytest.importorskip("mmwave.dataloader.adc")
    of = radar()
    numbers = any_codes(of)
    write(recording_from_cube(cube_of(numbers, of), of), tmp_path / "x.bin")

    words = np.fromfile(tmp_path / "x.bin", np.int16).reshape(len(numbers), -1)

    for frame, expected in zip(words, numbers, strict=True):
        read = adc.DCA1000.organize(frame, of.frame.n_chirps_total, 4, of.frame.chirp.n_samples)
        np.testing.assert_array_equal(read, expected[..., 0] + 1j * expected[..., 1])


def test_the_script_of_ti_reads_the_cube_of_two_lanes(tmp_path):
    # SWRA581, for xWR16xx: fileSize / 2 complex numbers, each pair of four words.
    of = radar(rx_mask=0b0111)
    numbers = any_codes(of)
    write(recording_from_cube(cube_of(numbers, of), of), tmp_path / "x.bin")

    adc = np.fromfile(tmp_path / "x.bin", "<i2").astype(float)
    lvds = np.zeros(adc.size // 2, complex)
    lvds[0::2] = adc[0::4] + 1j * adc[2::4]
    lvds[1::2] = adc[1::4] + 1j * adc[3::4]
    of_chirps = lvds.reshape(-1, 3 * of.frame.chirp.n_samples)

    expected = (numbers[..., 0] + 1j * numbers[..., 1]).reshape(of_chirps.shape)
    np.testing.assert_array_equal(of_chirps, expected)


def test_the_script_of_ti_reads_the_cube_of_four_lanes(tmp_path):
    # SWRA581, for xWR14xx: 8 words a sample, 4 real parts, then 4 imaginary ones. An odd number
    # of samples leaves only the chip that has no groups of two.
    of = radar("xwr1443", n_samples=127)
    numbers = any_codes(of)
    write(recording_from_cube(cube_of(numbers, of), of), tmp_path / "x.bin")

    adc = np.fromfile(tmp_path / "x.bin", "<i2").reshape(-1, 8).astype(float)
    of_lanes = (adc[:, :4] + 1j * adc[:, 4:]).T

    expected = np.moveaxis(numbers[..., 0] + 1j * numbers[..., 1], 2, 0).reshape(4, -1)
    np.testing.assert_array_equal(of_lanes, expected)
    assert json.loads((tmp_path / "x.mmwave.json").read_text())["mmWaveDevices"][0][
        "rawDataCaptureConfig"
    ]["rlDevLaneEnable_t"] == {"laneEn": "0xf"}


@given(
    exponent=st.integers(-60, 20),
    largest=st.floats(1.0, 2.0, exclude_max=True, width=32),
    seed=st.integers(0, 2**32 - 1),
)
def test_other_samples_are_rounded_by_half_a_step_of_the_smallest_that_fits(
    tmp_path_factory, exponent, largest, seed
):
    of = radar(n_chirps=1, tx_mask=0b1, rx_mask=0b1, n_samples=8)
    rng = np.random.default_rng(seed)
    samples = rng.uniform(-1, 1, (2, 1, 1, 8, 2)).astype(np.float32)
    samples.flat[rng.integers(samples.size)] = largest
    samples *= np.float32(2.0**exponent)
    cube = label_cube(samples.view(np.complex64)[..., 0], of, units="sqrt(W)")
    file = tmp_path_factory.mktemp("rounded") / "x.bin"

    write(recording_from_cube(cube, of), file)

    back = dc.open(file).cube
    step, words = back.attrs["scale"], np.fromfile(file, "<i2").astype(int)
    assert np.abs(back.values.view(np.float32) - cube.values.view(np.float32)).max() <= step / 2
    assert np.log2(step) % 1 == 0
    assert 2**14 - 1 <= np.abs(words).max() < 2**15
    (told,) = [one for one in dc.open(file).findings if one.setting == "scale"]
    assert f"rounded to steps of {step:.6g} sqrt(W)" in told.value


def test_codes_beyond_16_bits_are_rounded_and_never_wrapped(tmp_path):
    of = radar()
    cube = cube_of(any_codes(of), of)
    too_fine = cube.assign_attrs(scale=2.0**-17)

    write(recording_from_cube(too_fine, of), tmp_path / "x.bin")

    np.testing.assert_array_equal(dc.open(tmp_path / "x.bin").cube.values, cube.values)


def test_codes_of_12_bits_keep_their_full_scale_without_our_file(tmp_path):
    of = radar()
    cube = cube_of(any_codes(of, bits=12), of, scale=2.0**-11)
    write(recording_from_cube(cube, of), tmp_path / "x.bin")
    (tmp_path / "x.dechirp.json").unlink()

    back = dc.open(tmp_path / "x.bin")

    np.testing.assert_array_equal(back.cube.values, cube.values)
    assert back.cube.attrs["scale"] == 2.0**-11


def test_lost_chirps_stay_marked(tmp_path):
    of = radar()
    cube = cube_of(any_codes(of), of)
    lost = np.random.default_rng(2).random(cube.shape[:2]) < 0.1
    cube.values[lost] = 0
    cube = cube.assign_coords(gap=(("frame", "chirp"), lost))

    write(recording_from_cube(cube, of), tmp_path / "x.bin")

    back = dc.open(tmp_path / "x.bin")
    np.testing.assert_array_equal(back.cube.gap.values, lost)
    np.testing.assert_array_equal(next(back.select_frames(1, 2).frames()).gap.values[0], lost[1])


def test_the_calibration_of_the_radar_travels_along(tmp_path):
    of = radar()
    elements = tuple((tx, rx) for tx in range(3) for rx in range(4))
    gain = tuple((1.0, 0.01 * n) for n in range(12))
    calibrated = replace(of, calibration=dc.Calibration(elements=elements, gain=gain))

    write(recording_from_cube(cube_of(any_codes(of), of), calibrated), tmp_path / "x.bin")

    assert dc.open(tmp_path / "x.bin").radar == calibrated


def test_the_radar_that_the_user_gives_comes_before_that_of_the_file(tmp_path):
    of = radar()
    write(coded(of), tmp_path / "x.bin")
    other = replace(of, frame=replace(of.frame, interval_s=70e-6))

    assert dc.open(tmp_path / "x.bin", radar=other).radar == other


def test_a_capture_that_was_cut_gives_the_frames_that_are_whole(tmp_path):
    made = coded(radar(), n_frames=3)
    (file, *_) = write(made, tmp_path / "x.bin")
    file.write_bytes(file.read_bytes()[:-8])

    back = dc.open(file)

    assert back.n_frames == 2
    assert "cut short" in str(back.findings)
    np.testing.assert_array_equal(back.cube.values, made.cube.values[:2])


ARRAY_OF_FIVE = dc.Array(rx_m=tuple((0.0, 0.002 * n, 0.0) for n in range(5)))
ONE = radar(tx_mask=0b1)
SLOW = dc.Frame(
    chirp=chirp(sample_rate_hz=44.1e3, ramp_duration_s=20e-3), n_chirps=4, interval_s=30e-3
)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (replace(ONE, array=ARRAY_OF_FIVE), "5 antennas.*at most 4.*4 lanes"),
        (replace(ONE, frame=replace(ONE.frame, interval_s=(60e-6, 70e-6))), "a list of 2"),
        (
            replace(
                ONE,
                frame=replace(ONE.frame, modulation=dc.modulations.Triangular(), interval_s=90e-6),
            ),
            "ramps that differ",
        ),
        (
            replace(
                radar(tx_mask=0b11),
                frame=replace(ONE.frame, multiplexing=Bpm(order=(0, 1))),
            ),
            "several transmitters in a chirp",
        ),
        (replace(ONE, frame=SLOW), "rate in steps of 1 kS/s"),
    ],
    ids=["five receivers", "intervals", "ramps", "code", "slow"],
)
def test_a_radar_that_no_chip_can_be_is_refused(tmp_path, changed, said):
    with pytest.raises(DechirpError, match=said):
        write(coded(changed), tmp_path / "x.bin")
    assert list(tmp_path.iterdir()) == []


def test_an_odd_number_of_samples_is_refused_of_a_chip_that_writes_pairs(tmp_path):
    made = coded(radar(n_samples=127))
    of_1642 = replace(made, contents=replace(made.contents, device="xwr1642"))

    with pytest.raises(DechirpError, match="127 complex samples.*groups of two"):
        write(of_1642, tmp_path / "x.bin")


def test_samples_that_are_not_finite_are_refused(tmp_path):
    of = radar()
    cube = cube_of(any_codes(of), of)
    cube.values[1, 2, 3, 4] = np.nan

    with pytest.raises(DechirpError, match="non-finite"):
        write(recording_from_cube(cube, of), tmp_path / "x.bin")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["x.cfg", "x.mmwave.json", "x.dechirp.json"])
def test_settings_that_are_not_ours_are_not_overwritten(tmp_path, name):
    (tmp_path / name).write_text("of a real capture")

    with pytest.raises(DechirpError, match=name):
        write(coded(radar()), tmp_path / "x.bin")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [
        (name, "of a real capture")
    ]


def test_an_earlier_capture_of_ours_is_replaced_with_all_that_belongs_to_it(tmp_path):
    write(coded(radar()), tmp_path / "x.bin")
    no_board = replace(radar(tx_mask=0b1), array=dc.Array(rx_m=((0.0, 0.0, 0.0), (0.0, 0.1, 0.0))))

    written = write(coded(no_board), tmp_path / "x.bin")

    assert {path.name for path in written} == {"x.bin", "x.mmwave.json", "x.dechirp.json"}
    assert set(tmp_path.iterdir()) == set(written)
    back = dc.open(tmp_path / "x.bin")
    assert back.radar == no_board
    assert "not written: Radar.array.rx_m: positions that differ" in str(back.findings)


@pytest.mark.parametrize("ending", [".mmwave.json", ".dechirp.json"])
def test_a_full_disk_leaves_the_earlier_capture_as_it_was(tmp_path, monkeypatch, ending):
    write(coded(radar()), tmp_path / "x.bin")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    rename = Path.rename

    def on_a_full_disk(self, target):
        is_new = not self.name.endswith(".before")
        if is_new and Path(target).name == f"x{ending}":
            raise OSError(28, "No space left on device")
        return rename(self, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", on_a_full_disk)
        with pytest.raises(DechirpError, match="No space left"):
            write(coded(radar(), seed=5), tmp_path / "x.bin")

    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_disk_that_fills_with_samples_leaves_the_earlier_capture_as_it_was(tmp_path):
    write(coded(radar()), tmp_path / "x.bin")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}

    def full(done, of_all):
        raise OSError(28, "No space left on device")

    with pytest.raises(DechirpError, match="No space left"):
        write(coded(radar(), seed=5), tmp_path / "x.bin", progress=full)

    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_only_a_name_of_a_capture_is_written(tmp_path):
    with pytest.raises(DechirpError, match=r"ends in \.bin"):
        write(coded(radar()), tmp_path / "x.cfg", format="dca1000")


SMALL = radar(n_chirps=1, tx_mask=0b1, rx_mask=0b1, n_samples=8)


@pytest.fixture(scope="module")
def kept(tmp_path_factory) -> Path:
    """A small capture with a table and lost chirps."""
    folder = tmp_path_factory.mktemp("kept")
    cube = cube_of(any_codes(SMALL), SMALL).assign_coords(
        gap=(("frame", "chirp"), [[True], [False]])
    )
    table = xr.Dataset({"label": ("target", ["car", "a van"]), "rcs": ("target", [1.0, np.nan])})
    write(recording_from_cube(cube, SMALL, tables={"truth": table}), folder / "x.bin")
    return folder / "x.bin"


@given(data=st.data())
def test_whatever_is_beside_it_a_capture_is_read_or_refused(kept, data):
    file = kept.with_suffix(".dechirp.json")
    whole = file.read_bytes()
    try:
        file.write_bytes(data.draw(damaged(whole)))
        gives_a_cube_or_says_why(kept)
    finally:
        file.write_bytes(whole)


LAYOUT = {"device": None, "lanes": 2, "receivers": [0], "iq": "iq", "n_frames": 2}
HOSTILE = {
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


@pytest.mark.parametrize("changes", HOSTILE.values(), ids=HOSTILE)
def test_what_dechirp_did_not_write_is_refused(kept, tmp_path, changes):
    for ending in (".bin", ".dechirp.json"):
        (tmp_path / f"x{ending}").write_bytes(kept.with_suffix(ending).read_bytes())
    file = tmp_path / "x.dechirp.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))

    with pytest.raises(RecordingError):
        dc.open(tmp_path / "x.bin")


def test_a_text_of_a_million_lists_is_not_taken_apart(kept, tmp_path):
    (tmp_path / "x.bin").write_bytes(kept.read_bytes())
    whole = kept.with_suffix(".dechirp.json").read_text()
    (tmp_path / "x.dechirp.json").write_text(whole[:-3] + ', "more": [' + "[]," * 2**20 + "0]}")

    with pytest.raises(RecordingError, match="objects and lists"):
        dc.open(tmp_path / "x.bin")


def test_a_link_to_another_folder_is_left_alone(kept, tmp_path):
    (tmp_path / "x.bin").write_bytes(kept.read_bytes())
    (tmp_path / "x.dechirp.json").symlink_to(kept.with_suffix(".dechirp.json"))

    with pytest.raises(RecordingError, match="no settings"):
        dc.open(tmp_path / "x.bin")


def test_a_table_with_texts_and_missing_numbers_comes_back(kept):
    (table,) = dc.open(kept).tables.values()

    assert list(table.label.values) == ["car", "a van"]
    assert struct.pack("<2d", *table.rcs.values) == struct.pack("<2d", 1.0, np.nan)
