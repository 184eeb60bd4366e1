"""Settings files: values, defaults, overrides, and mistakes with line and column."""

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.config.dumping import dump_yaml, to_json_data
from dechirp.config.fields import field_docstrings
from dechirp.config.loading import parse_settings, read_settings
from dechirp.core.errors import InvalidFile, InvalidSetting, RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.processing.chain import Chain
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.ddma import Ddma
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.noise import ThermalNoise, WhiteNoise
from nightly import n_examples

RADAR = """\
frame:
  chirp: {start_frequency: 77 GHz, slope: 10 MHz/us, adc_start: 3 us, ramp_duration: 29 us,
          sample_rate: 10 MHz, n_samples: 256, sampling: complex}       # or real
  n_chirps: 128
  interval: 35 us
  period: 50 ms
array:
  rx: [[0 mm, 0 mm, 0 mm], [0 mm, 1.944 mm, 0 mm], [0 mm, 3.888 mm, 0 mm], [0 mm, 5.832 mm, 0 mm]]
hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB, loss: 1 dB}
"""

SCENE = """\
targets:
  - {name: car, position: [60 m, 3 m, 0 m], velocity: [8 m/s, 0 m/s, 0 m/s], rcs: 10 dBsm}
  - {name: truck, position: [90 m, -4 m, 0 m], rcs: 20 dBsm}
"""


@frozen_dataclass
class Setup:
    """Settings of several kinds for these tests."""

    radar: Radar | None = None
    """What sends,
    and receives."""
    path: str | None = None
    scene: Scene = Scene()
    impairments: tuple[Impairment, ...] = ()
    chain: Chain = Chain()
    is_quiet: bool = False


def collect_mistakes(text, kind, **options):
    """Return all mistakes in a text, by setting."""
    with pytest.raises(InvalidFile) as error:
        parse_settings(text, kind, **options)
    message = str(error.value)
    assert (
        "Input should" not in message and "Field required" not in message and "http" not in message
    )
    return {mistake.setting: mistake for mistake in error.value.mistakes}


def expect_mistake(text, kind, **options):
    """Return the only mistake in a text."""
    (mistake,) = collect_mistakes(text, kind, **options).values()
    return mistake


def test_radar_settings_with_units_become_si_values():
    radar = parse_settings(RADAR, Radar)

    chirp = Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=10e12,
        adc_start_s=3e-6,
        ramp_duration_s=29e-6,
        sample_rate_hz=10e6,
        n_samples=256,
        sampling="complex",
    )
    assert radar.frame == Frame(chirp=chirp, n_chirps=128, interval_s=35e-6, period_s=50e-3)
    assert radar.array == Array(rx_m=[(0, 0.001944 * n, 0) for n in range(4)])
    assert radar.hardware.transmit_power_w == pytest.approx(0.0158489, rel=1e-5)  # six digits
    assert radar.hardware.antenna_gain == 10


def test_dumped_settings_read_back_equal(radar):
    setup = Setup(
        radar=radar,
        scene=Scene(targets=[Target(name="1e5", position_m=(1 / 3, 0, 0), rcs_m2=0.1)]),
        impairments=(WhiteNoise(snr=0.003, target="null"), ThermalNoise()),
    )

    assert parse_settings(dump_yaml(setup), Setup) == setup


def add_multiplexing(text):
    """Return the radar settings with two transmitters and a multiplexing entry."""
    array = "array:\n  tx: [[0 mm, 0 mm, 0 mm], [0 mm, 7.776 mm, 0 mm]]\n"
    radar = RADAR.replace("array:\n", array)
    return radar.replace("  period: 50 ms\n", f"  period: 50 ms\n  multiplexing: {text}\n")


def test_tdm_settings_are_read_and_written():
    radar = parse_settings(add_multiplexing("{kind: tdm, order: [1, 0]}"), Radar)

    assert radar.frame.multiplexing == Tdm(order=(1, 0))
    assert radar.n_channels == 8
    assert parse_settings(dump_yaml(radar), Radar) == radar
    multiplexing = to_json_data(radar)["frame"]["multiplexing"]
    assert multiplexing == {"kind": "tdm", "order": [1, 0], "pause_s": None}


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("{kind: bpm, order: [1, 0]}", Bpm(order=(1, 0))),
        ("{kind: tdm, order: [1, 0], pause: 2.5 us}", Tdm(order=(1, 0), pause_s=2.5e-6)),
        ("{kind: ddma, order: [0, 1], n_sub_bands: 3}", Ddma(order=(0, 1), n_sub_bands=3)),
        (
            "{kind: phase-code, phases: [[0, 90 deg], [-1.1 rad, 0.1 rad]]}",
            PhaseCode(phases_rad=[[0, math.pi / 2], [-1.1, 0.1]]),
        ),
        (
            "{kind: phase-code, phases: [[0, 90 deg], [null, 0.1 rad]]}",
            PhaseCode(phases_rad=[[0, math.pi / 2], [None, 0.1]]),
        ),
    ],
    ids=["bpm", "tdm-pause", "ddma", "phase-code", "phase-code-silent"],
)
def test_simultaneous_multiplexing_settings_are_read_and_written(text, code):
    radar = parse_settings(add_multiplexing(text), Radar)

    assert radar.frame.multiplexing == code
    assert parse_settings(dump_yaml(radar), Radar) == radar
    assert to_json_data(radar)["frame"]["multiplexing"]["kind"] == code.kind()


@pytest.mark.parametrize(
    ("text", "setting", "value", "expected"),
    [
        (
            "null",
            "",
            "missing, with 2 transmitters in the array",
            "a multiplexing scheme, since several transmitters share the chirps",
        ),
        ("tdm", "", "tdm", "a mapping with kind: bpm, ddma, phase-code, tdm, or null"),
        ("{order: [0, 1]}", ".kind", "missing", "one of bpm, ddma, phase-code, tdm"),
        ("{kind: tdmm, order: [0, 1]}", ".kind", "tdmm", "one of bpm, ddma, phase-code, tdm"),
        ("{kind: tdm}", ".order", "missing", "a list, each a whole number"),
        ("{kind: tdm, ordr: [0, 1]}", ".ordr", "unknown setting", "one of kind, order"),
        ("{kind: tdm, order: [0, 1.5]}", ".order.1", "1.5", "a whole number"),
        ("{kind: tdm, order: 1}", ".order", "1", "a list, each a whole number"),
        ("{kind: tdm, order: []}", ".order", "()", "at least one transmitter"),
        ("{kind: tdm, order: [1, 1]}", ".order", "1, 1", "every transmitter once"),
        ("{kind: tdm, order: [0, -1]}", ".order", "-1", "a whole number from 0"),
        ("{kind: tdm, order: [1, 2]}", "", "2 transmitters: 1, 2", "the 2 in array.tx: 0, 1"),
        ("{kind: bpm, order: [0]}", "", "1 transmitter: 0", "the 2 in array.tx: 0, 1"),
        ("{kind: ddma, order: [0, 1], n_sub_bands: 1}", ".n_sub_bands", "1", "at least 2"),
        ("{kind: ddma, order: [0, 1]}", ".n_sub_bands", "missing", "a whole number"),
        ("{kind: phase-code, phases: [[0, 90]]}", ".phases.0.1", "90", "an angle, such as 30 deg"),
        ("{kind: phase-code, phases: [[0, 0], [0]]}", ".phases.1", "a row of 1 phases", "2 phases"),
        ("{kind: phase-code, phases: [[0]]}", "", "1 transmitter: 0", "the 2 in array.tx: 0"),
    ],
)
def test_invalid_multiplexing_is_reported_with_setting_and_line(text, setting, value, expected):
    mistake = expect_mistake(add_multiplexing(text), Radar)

    assert (mistake.setting, mistake.line) == (f"frame.multiplexing{setting}", 7)
    assert mistake.value == value
    assert expected in mistake.expected
    assert mistake.fix


def test_override_of_kind_starts_from_defaults_of_that_kind():
    """Defaults of the previous kind would be rejected, although no file contains them."""
    override_settings = parse_settings(
        "{}", Setup, overrides=["chain.angle.kind=music", "chain.angle.n_sources=2"]
    )
    file_settings = parse_settings("{chain: {angle: {kind: music, n_sources: 2}}}", Setup)
    repeated_settings = parse_settings(
        "{chain: {angle: {kind: music, n_sources: 2}}}", Setup, overrides=["chain.angle.kind=music"]
    )

    assert override_settings == file_settings == repeated_settings


def test_excessive_frequency_step_is_reported_with_setting():
    step = "  modulation: {kind: frequency-shift-keying, step: 90 GHz}\n"
    mistake = expect_mistake(RADAR.replace("  period: 50 ms\n", "  period: 50 ms\n" + step), Radar)

    assert (mistake.setting, mistake.value) == ("frame.modulation.step", "90 GHz")


def test_override_changes_multiplexing():
    without_scheme, with_scheme = (
        add_multiplexing("null"),
        add_multiplexing("{kind: tdm, order: [0, 1]}"),
    )
    changed_order = parse_settings(
        with_scheme, Radar, overrides=["frame.multiplexing.order=[1, 0]"]
    )
    added_scheme = parse_settings(
        without_scheme, Radar, overrides=["frame.multiplexing={kind: tdm, order: [1, 0]}"]
    )

    assert (
        changed_order
        == added_scheme
        == parse_settings(add_multiplexing("{kind: tdm, order: [1, 0]}"), Radar)
    )


def test_dumped_radar_keeps_units_and_omits_none():
    text = dump_yaml(Radar(frame=parse_settings(RADAR, Radar).frame))

    assert "slope: 10 MHz/us" in text
    assert "hardware" not in text


@settings(max_examples=n_examples(200), deadline=None)
@given(
    name=st.text(st.characters(codec="utf-8", exclude_categories=["C"]), min_size=1),
    rcs_m2=st.floats(1e-12, 1e12),
    position_m=st.tuples(*[st.floats(-1e9, 1e9)] * 3),
)
def test_any_target_reads_back_equal(name, rcs_m2, position_m):
    target = Target(name=name, rcs_m2=rcs_m2, position_m=position_m)

    assert parse_settings(dump_yaml(target), Target) == target


def test_json_data_has_field_names():
    numbers = to_json_data(
        Setup(radar=parse_settings(RADAR, Radar), impairments=(WhiteNoise(snr=2.0),))
    )

    assert numbers["radar"]["frame"]["chirp"]["slope_hz_per_s"] == 10e12
    assert numbers["radar"]["array"]["tx_m"] == [[0.0, 0.0, 0.0]]
    assert numbers["impairments"] == [{"kind": "white-noise", "snr": 2.0, "target": None}]


def test_all_mistakes_in_file_are_reported_in_order():
    text = RADAR.replace("77 GHz", "7 apples").replace("n_chirps", "n_chrips")
    text = text.replace("50 ms", "50 m").replace("transmit_power: 12 dBm, ", "")

    with pytest.raises(InvalidFile) as error:
        parse_settings(text, Radar, file="radar.yaml")

    assert str(error.value).splitlines() == [
        "radar.yaml:2:28: frame.chirp.start_frequency: 7 apples; expected a frequency, such as"
        " 77 GHz; units that fit: GHz, MHz, kHz, Hz, MS/s, kS/s",
        "radar.yaml:4:3: frame.n_chrips: unknown setting; expected one of chirp, n_chirps,"
        " interval, period, multiplexing, modulation; did you mean n_chirps?",
        "radar.yaml:6:11: frame.period: 50 m; expected a time, such as 35 us;"
        " did you mean ms? units that fit: s, ms, us, ns, min, h",
        "radar.yaml:9:1: hardware.transmit_power: missing; expected a power, such as"
        " 12 dBm; add transmit_power",
    ]


@pytest.mark.parametrize(
    ("original", "replacement", "setting", "value", "expected"),
    [
        ("n_chirps: 128", "n_chirps: 12.5", "frame.n_chirps", "12.5", "a whole number"),
        ("n_chirps: 128", "n_chirps: '128'", "frame.n_chirps", "the text '128'", "a whole number"),
        ("n_chirps: 128", "n_chirps: true", "frame.n_chirps", "true", "a whole number"),
        ("n_chirps: 128", "n_chirps: [1]", "frame.n_chirps", "a list of 1", "a whole number"),
        ("n_chirps: 128", "n_chirps:", "frame.n_chirps", "null", "a whole number"),
        ("n_chirps: 128", "n_chirps: -4", "frame.n_chirps", "-4", "a whole number from 1"),
        ("n_chirps: 128", "n_chirps: 0", "frame.n_chirps", "0", "a whole number from 1"),
        ("n_chirps: 128", f"n_chirps: {10**30}", "frame.n_chirps", str(10**30), "to 2147483647"),
        ("10 MHz,", "10000000,", "frame.chirp.sample_rate", "10000000", "a frequency"),
        ("10 MHz,", "-10 MHz,", "frame.chirp.sample_rate", "-10 MHz", "above 0"),
        ("10 MHz,", "{a: 1},", "frame.chirp.sample_rate", "a mapping", "a frequency"),
        ("10 MHz,", "1e300 GHz,", "frame.chirp.sample_rate", "1e300 GHz", "below 1e308"),
        ("29 us", "2 us", "frame.chirp.ramp_duration", "2 us", "at least 28.5 us"),
        ("complex}", "complx}", "frame.chirp.sampling", "complx", "one of complex, real"),
        ("[0 mm, 1.944 mm, 0 mm]", "[0 mm]", "array.rx.1", "a list of 1", "a list of 3"),
        ("1.944 mm", "1.944 s", "array.rx.1.1", "1.944 s", "a length"),
        (
            "noise_factor: 12 dB",
            "noise_factor: -3 dB",
            "hardware.noise_factor",
            "-3 dB",
            "at least 0 dB",
        ),
    ],
)
def test_invalid_value_is_reported_with_setting_value_and_expectation(
    original, replacement, setting, value, expected
):
    text = RADAR.replace(original, replacement, 1)
    mistake = expect_mistake(text, Radar)

    assert (mistake.setting, mistake.value) == (setting, value)
    assert expected in mistake.expected
    assert mistake.fix
    assert text.splitlines()[mistake.line - 1] not in RADAR.splitlines()


def test_duplicate_name_is_reported_at_second_occurrence():
    mistake = expect_mistake(RADAR.replace("  interval", "  n_chirps: 64\n  interval"), Radar)

    assert (mistake.setting, mistake.line, mistake.column) == ("frame.n_chirps", 5, 3)
    assert mistake.value == "given twice, first on line 4"


def test_list_members_are_addressed_by_name_kind_or_index():
    text = "scene:\n  targets:\n  - {name: car, position: [1 m, 0 m, 0 m], rcs: 0}\n  - 7\n"
    text += "impairments: [{kind: white-noise}, {kind: thermal-noise, power: 1 W}, {kind: nose}]\n"

    assert list(collect_mistakes(text, Setup)) == [
        "scene.targets.car.rcs",
        "scene.targets.1",
        "impairments.white-noise.snr",
        "impairments.thermal-noise.power",
        "impairments.nose.kind",
    ]


def test_kind_selects_member_of_family():
    text = "impairments: [{kind: white-noise, snr: -10 dB}, {kind: thermal-noise}]"

    assert parse_settings(text, Setup).impairments == (WhiteNoise(snr=0.1), ThermalNoise())
    mistake = expect_mistake(text.replace("thermal-noise", "thermal_noise"), Setup)
    assert mistake.setting == "impairments.thermal_noise.kind"
    assert mistake.fix == "did you mean thermal-noise?"


def test_optional_settings_accept_null_and_only_known_names():
    assert parse_settings("chain: {cluster: null}", Setup) == Setup()
    mistake = expect_mistake("chain: {cluster: {kind: dbscan}}", Setup)
    assert mistake.setting == "chain.cluster.kind"
    assert mistake.expected == "one of reach, min_detections"


def test_rejects_probability_in_decibels():
    text = "chain: {cfar: {estimator: {kind: cell-averaging}, false_alarm_probability: -60 dB}}"

    mistake = expect_mistake(text, Setup)
    assert (mistake.setting, mistake.fix) == (
        "chain.cfar.false_alarm_probability",
        "omit the unit",
    )


@pytest.mark.parametrize(
    ("text", "line", "column"),
    [
        ("a: b: c", 1, 5),
        ("frame:\n\tchirp: 1", 2, 1),
        ("frame: {chirp: [", 1, 17),
        ("a: \x00", 1, 4),
        ("a: &x 1\nb: *x", 1, 4),
        ("frame: !!python/object:os.system {}", 1, 8),
        ("a: 1\n---\nb: 2", 2, 1),
        ("[a]: 1", 1, 1),
        ("[" * 100_000, 1, 34),
        ('a: "\\UFFFFFFFF"', None, None),
    ],
)
def test_yaml_syntax_error_has_line_and_column(text, line, column):
    mistake = expect_mistake(text, Radar)

    assert (mistake.line, mistake.column) == (line, column)


@pytest.mark.parametrize("text", ["", "# nothing\n", "- 1", "7", "frame"])
def test_text_without_mapping_gives_one_mistake(text):
    assert (
        expect_mistake(text, Radar).expected == "a mapping of frame, array, hardware, calibration"
    )


@pytest.mark.parametrize(
    ("content", "value"),
    [(b"\xff\xfe\x00", "not text"), (b"# \n" * 2**19, "1.5 MiB"), (b"", "empty"), (None, "folder")],
)
def test_unreadable_file_gives_one_mistake(tmp_path, content, value):
    path = tmp_path / "radar.yaml"
    path.mkdir() if content is None else path.write_bytes(content)

    with pytest.raises(InvalidFile) as error:
        read_settings(path, Radar)

    (mistake,) = error.value.mistakes
    assert mistake.file == str(path)
    assert value in mistake.value


def test_missing_file_gives_one_mistake(tmp_path):
    with pytest.raises(InvalidFile, match="the file: not found"):
        read_settings(tmp_path / "radar.yaml", Radar)


def test_paths_are_relative_to_settings_file(tmp_path):
    (tmp_path / "radar.yaml").write_text(RADAR)
    (tmp_path / "setup.yaml").write_text("radar: radar.yaml\npath: sub/x.npy\n")

    setup = read_settings(
        tmp_path / "setup.yaml", Setup, readers={Radar: lambda path: read_settings(path, Radar)}
    )

    assert setup.radar == parse_settings(RADAR, Radar)
    assert Path(setup.path) == tmp_path / "sub" / "x.npy"


def test_mistakes_in_referenced_file_are_reported_with_others(tmp_path):
    (tmp_path / "radar.yaml").write_text("frame: 1")
    (tmp_path / "setup.yaml").write_text("radar: radar.yaml\nchian: 1\n")

    with pytest.raises(InvalidFile) as error:
        read_settings(
            tmp_path / "setup.yaml", Setup, readers={Radar: lambda path: read_settings(path, Radar)}
        )

    assert {(Path(m.file).name, m.setting) for m in error.value.mistakes} == {
        ("radar.yaml", "frame"),
        ("setup.yaml", "chian"),
    }


def test_error_of_custom_reader_passes_through():
    def refuse(path):
        raise RecordingError(path, value="nothing", expected="something", fix="Look.")

    with pytest.raises(RecordingError):
        parse_settings("radar: x.cfg", Setup, readers={Radar: refuse})


def test_override_replaces_value_of_file():
    setup = parse_settings(
        f"scene:\n  {SCENE.replace(chr(10), chr(10) + '  ')}",
        Setup,
        overrides=["scene.targets.truck.rcs=3 m^2", "scene.targets.0.name = van", "is_quiet=true"],
    )

    assert [target.rcs_m2 for target in setup.scene.targets] == [10, 3]
    assert setup.scene.names == ("van", "truck")
    assert setup.is_quiet


def test_override_of_nested_setting_keeps_other_defaults():
    chain = parse_settings("{}", Setup, overrides=["chain.cfar.n_training.range=5"]).chain

    assert chain.cfar.n_training.range == 5
    assert chain.cfar.n_training.velocity == Chain().cfar.n_training.velocity


def test_override_changes_radar_of_referenced_file():
    radar = parse_settings(RADAR, Radar)
    changed_radar = parse_settings(
        "radar: vendor.cfg",
        Setup,
        overrides=["radar.frame.n_chirps=64"],
        readers={Radar: lambda path: radar},
    ).radar

    assert changed_radar.frame.n_chirps == 64
    assert changed_radar.frame.chirp == radar.frame.chirp


def test_rejects_cfar_offset_with_probability_until_one_is_null():
    offset, clear = "chain.cfar.offset=15 dB", "chain.cfar.false_alarm_probability=null"

    mistake = expect_mistake("{}", Setup, overrides=[offset])
    assert mistake.setting == "chain.cfar.false_alarm_probability"
    assert "offset" in mistake.value
    cfar = parse_settings("{}", Setup, overrides=[offset, clear]).chain.cfar
    assert cfar.offset == pytest.approx(31.6228, rel=1e-5)  # six digits


@pytest.mark.parametrize(
    ("option", "setting", "fix"),
    [
        ("chain.cfr.offset=3 dB", "chain.cfr", "did you mean cfar?"),
        ("targets.cra.rcs=1 m^2", "targets.cra", "did you mean car?"),
        ("targets.car.rcs=1 m", "targets.car.rcs", "units that fit: dBsm, m^2"),
        ("targets.car.rcs=-1 m^2", "targets.car.rcs", "give a positive value"),
        ("targets.car.rcs.db=1", "targets.car.rcs.db", "set targets.car.rcs itself"),
        (
            "targets=[{name: car, position: [0, 0, 0], name: van}]",
            "targets.car.name",
            "keep one of them",
        ),
        ("targets.car.rcs=[", "targets.car.rcs", "correct it there, or just before"),
    ],
)
def test_mistake_in_override_is_attributed_to_set_option(option, setting, fix):
    is_chain_option = option.startswith("chain")
    mistake = expect_mistake(
        "{}" if is_chain_option else SCENE, Setup if is_chain_option else Scene, overrides=[option]
    )

    assert (mistake.file, mistake.line, mistake.column) == ("--set", None, None)
    assert (mistake.setting, mistake.fix) == (setting, fix)


def test_override_without_value_is_reported_by_option_only():
    mistake = expect_mistake(SCENE, Scene, overrides=["targets.car.rcs"])

    assert str(mistake) == (
        "--set: targets.car.rcs; expected PATH=VALUE;"
        " write --set PATH=VALUE, such as --set radar.frame.n_chirps=64"
    )


def test_error_in_nested_value_has_line_of_file():
    @frozen_dataclass
    class Narrow(Setup):
        def __post_init__(self):
            raise InvalidSetting("scene.targets.car.rcs_m2", value=0.1, expected="1", fix="More.")

    text = "scene:\n  targets:\n  - {position: [1 m, 0 m, 0 m]}\n"
    text += "  - {name: car, position: [1 m, 0 m, 0 m], rcs: -10 dBsm}\n"

    mistake = expect_mistake(text, Narrow)
    assert (mistake.setting, mistake.line, mistake.value) == (
        "scene.targets.car.rcs",
        4,
        "-10 dBsm",
    )
    # A missing setting is reported at the place of its parent.
    assert expect_mistake("scene: {targets: []}", Narrow).column == 9


def test_field_docstring_is_its_help_text():
    docstrings = field_docstrings(Setup)

    assert docstrings["radar"] == "What sends, and receives."
    assert docstrings["scene"] == ""
    assert list(field_docstrings(Hardware)) == [
        "transmit_power_w",
        "antenna_gain",
        "tx_pattern",
        "rx_pattern",
        "noise_factor",
        "loss",
    ]


TEXT_PIECES = st.sampled_from(list(" \n\t:-,[]{}'\"|>&*!#?%@~\\0e")) | st.sampled_from(
    ["frame", "chirp", "n_chirps", "tx", "77 GHz", "1e999 dB", "null", "...", ": ", "\n  "]
)


@settings(max_examples=n_examples(500), deadline=None)
@given(
    st.text()
    | st.lists(TEXT_PIECES, max_size=40).map(" ".join)
    | st.lists(TEXT_PIECES).map("".join)
)
def test_any_text_gives_radar_or_mistakes(text):
    try:
        parse_settings(text, Radar)
    except InvalidFile as error:
        assert error.mistakes


@settings(max_examples=n_examples(500), deadline=None)
@given(
    st.sampled_from(RADAR.replace(",", " ,").replace("}", " }").split()),
    st.text(max_size=8) | st.lists(TEXT_PIECES, max_size=4).map("".join),
)
def test_radar_text_with_any_changed_word_gives_radar_or_mistakes(original, replacement):
    try:
        parse_settings(RADAR.replace(original, replacement, 1), Radar)
    except InvalidFile as error:
        assert all(mistake.fix for mistake in error.mistakes)


@settings(max_examples=n_examples(300), deadline=None)
@given(st.text() | st.lists(TEXT_PIECES, max_size=9).map(".".join).map("frame.{}=1".format))
def test_any_override_is_accepted_or_rejected(option):
    try:
        parse_settings(RADAR, Radar, overrides=[option])
    except InvalidFile as error:
        assert error.mistakes


@pytest.mark.parametrize(
    "frame_text",
    [
        "interval: [35 us, 38.5 us]",
        "interval: 35 us\n  modulation: {kind: triangular}",
        "interval: 35 us\n  modulation: {kind: frequency-shift-keying, step: -20 MHz}",
        "interval: 35 us\n  modulation: {kind: staggered, pauses: [0 s, 2.5 us]}",
    ],
)
def test_alternating_intervals_and_modulations_read_back_equal(frame_text):
    radar = parse_settings(RADAR.replace("interval: 35 us", frame_text), Radar)
    assert radar.frame.n_intervals + radar.frame.n_slots == 3
    assert parse_settings(dump_yaml(radar), Radar) == radar


def test_invalid_interval_in_list_is_reported_with_index():
    assert expect_mistake(
        RADAR.replace("interval: 35 us", "interval: [35 us, 5 us]"), Radar
    ).setting == ("frame.interval.1")
    for intervals in ("[35 us]", "[35 us, 38 apples]", "35 apples"):
        error = expect_mistake(RADAR.replace("interval: 35 us", f"interval: {intervals}"), Radar)
        assert error.setting.startswith("frame.interval")
