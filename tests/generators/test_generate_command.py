"""`dechirp generate` and `dc.generators`: files, refused settings, existing folders, interrupts."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.core.errors import DechirpError
from dechirp.generators.base import Design, Generator
from generators.compiled_c import make_radar, small_window_chain

SMALL_SETTINGS = ["--set", "radar.frame.n_chirps=32", "--set", "chain.n_range_bins=4096"]
LANGUAGES = sorted(Generator.members())


def run_cli(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_info:
        main(["generate", *arguments])
    captured = capsys.readouterr()
    return int(exit_info.value.code or 0), captured.out, captured.err


def read_texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}


def make_generator(language: str, **settings: str) -> Generator:
    member = Generator.members()[language]
    assert issubclass(member, Generator)
    return member(**settings)


@pytest.mark.parametrize("language", LANGUAGES)
def test_files_carry_version_and_settings_that_reproduce_them(tmp_path, capsys, language):
    words = tmp_path / "given.yaml"
    words.write_text("range_bits: 18\nscaling: halving\n")
    first, second = tmp_path / "first", tmp_path / "second"
    options = ["--words", str(words), "--prefix", "front_left", "--json", *SMALL_SETTINGS]

    status, output, _ = run_cli(capsys, language, "--out", str(first), *options)
    texts = read_texts(first)
    again, _, errors = run_cli(
        capsys, language, str(first / "settings.yaml"), "--out", str(second),
        "--words", str(first / "words.yaml"), "--prefix", "front_left",
    )  # fmt: skip

    assert (status, again) == (0, 0), errors
    assert json.loads(output) == {
        "language": language,
        "files": {name: str(first / name) for name in json.loads(output)["files"]},
    }
    assert set(json.loads(output)["files"]) == set(texts)
    assert all(f"dechirp {dc.__version__}" in text for text in texts.values())
    assert read_texts(second) == texts


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["d"], "LANGUAGE: d; expected one of c"),
        (["{language}", "--prefix", "2nd"], "--prefix: '2nd'; expected a letter"),
        (["{language}", "--prefix", "_radar"], "--prefix: '_radar'"),
        (["{language}", "--prefix", "front-left"], "choose a name such as radar or front_left"),
        (["{language}", "--prefix", "a" * 16], "15 characters at most"),
        (["{language}", "--prefix", "radär"], "--prefix"),
        (["{language}", "--prefix", "lpt1"], "no word of the language, its tools"),
        (["{language}", "--set", "chain.n_range_bins=5000"], "set n_range_bins to 8192"),
        (["{language}", "--set", "chain.cfar.estimator.kind=ordered-statistic"], "chain.cfar."),
        (["{language}", "--words", "nowhere.yaml"], "nowhere.yaml: the file: not found"),
        (["{language}", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
@pytest.mark.parametrize("language", LANGUAGES)
def test_refuses_invalid_calls_and_writes_nothing(tmp_path, capsys, language, arguments, message):
    words = [word.format(language=language) for word in arguments]
    status, _, errors = run_cli(capsys, *words, "--out", str(tmp_path / "code"))
    assert (status, list(tmp_path.iterdir())) == (2, [])
    assert message in errors and "Traceback" not in errors


# stdint hides a header; make has targets of its own, and would make its Makefile of makefile.c.
@pytest.mark.parametrize(
    "prefix",
    [
        "main",
        "int",
        "Static",
        "CON",
        "COM1",
        "stdint",
        "all",
        "Makefile",
        "",
        "a b",
        'x"y',
        3,
        None,
    ],
)
def test_c_refuses_prefixes_that_are_no_names(prefix):
    with pytest.raises(dc.InvalidSetting, match=r"C\.prefix"):
        dc.generators.C(prefix=prefix)


@pytest.mark.parametrize("language", LANGUAGES)
def test_pads_transforms_as_the_command_does(tmp_path, language):
    generator = make_generator(language)
    radar = make_radar(50, 20)
    generator.write(tmp_path / "padded", radar, small_window_chain())
    set_lengths = small_window_chain(n_range_bins=64, n_velocity_bins=32)
    generator.write(tmp_path / "set", radar, set_lengths)
    assert read_texts(tmp_path / "padded") == read_texts(tmp_path / "set")


# Recordings state no hardware.
@pytest.mark.parametrize("language", LANGUAGES)
def test_settings_of_a_radar_without_hardware_reproduce_the_files(tmp_path, capsys, language):
    radar = replace(make_radar(64, 16), hardware=None)
    make_generator(language).write(tmp_path / "first", radar, small_window_chain())
    status, _, errors = run_cli(
        capsys, language, str(tmp_path / "first" / "settings.yaml"),
        "--words", str(tmp_path / "first" / "words.yaml"), "--out", str(tmp_path / "second"),
    )  # fmt: skip
    assert status == 0, errors
    assert read_texts(tmp_path / "first") == read_texts(tmp_path / "second")
    with pytest.raises(SystemExit, match="2"):
        main(["run", str(tmp_path / "first" / "settings.yaml"), "--out", str(tmp_path / "run")])
    assert "hardware: missing" in capsys.readouterr().err


@pytest.mark.parametrize("language", LANGUAGES)
def test_refuses_settings_without_fixed_point_form(tmp_path, language):
    radar, generator = make_radar(64, 16), make_generator(language)
    for chain, message in (
        (small_window_chain(n_velocity_bins=24), "set n_velocity_bins to 32"),
        (small_window_chain(range_walk="keystone"), "range_walk"),
    ):
        with pytest.raises(dc.InvalidSetting, match=message):
            generator.write(tmp_path / "code", radar, chain)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_replaces_own_folder_and_keeps_folder_of_others(tmp_path, language):
    radar, generator, out = make_radar(64, 16), make_generator(language), tmp_path / "code"
    files = generator.write(out, radar, small_window_chain())
    (out / "build").mkdir()
    for product in generator.build_products() - {"build"}:
        (out / product.replace("*", "any")).write_text("built")
    generator.write(out, radar, small_window_chain(n_range_bins=128))
    assert set(read_texts(out)) == set(files)

    with pytest.raises(DechirpError, match="written with the prefix radar: keep that prefix"):
        make_generator(language, prefix="front").write(out, radar, small_window_chain())
    (out / "notes.txt").write_text("mine")
    before = read_texts(out)
    with pytest.raises(DechirpError, match=r"a folder with notes\.txt.*outside of it"):
        generator.write(out, radar, small_window_chain())
    with pytest.raises(DechirpError, match="not writable|a file"):
        generator.write(out / "notes.txt" / "code", radar, small_window_chain())
    assert read_texts(out) == before
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize("language", LANGUAGES)
def test_interrupted_writing_leaves_earlier_folder(tmp_path, language, monkeypatch):
    radar, generator, out = make_radar(64, 16), make_generator(language), tmp_path / "code"
    generator.write(out, radar, small_window_chain())
    before, write_text, written = read_texts(out), Path.write_text, []

    def interrupt_third_file(path, *arguments, **options):
        written.append(path)
        if len(written) == 3:
            raise KeyboardInterrupt
        return write_text(path, *arguments, **options)

    monkeypatch.setattr(Path, "write_text", interrupt_third_file)
    with pytest.raises(KeyboardInterrupt):
        generator.write(out, radar, small_window_chain(n_range_bins=128))
    assert read_texts(out) == before
    assert list(tmp_path.iterdir()) == [out]


def test_lines_of_c_have_100_characters_at_most(tmp_path):
    radar = replace(make_radar(64, 16), array=dc.Array(rx_m=[(0, k / 7e3, 0) for k in range(16)]))
    dc.generators.C().write(tmp_path / "code", radar, small_window_chain())
    texts = [
        text for name, text in read_texts(tmp_path / "code").items() if name[-2:] in (".c", ".h")
    ]
    assert max(len(line) for text in texts for line in text.splitlines()) <= 100


def test_settings_cannot_end_comment_of_c(tmp_path, monkeypatch):
    monkeypatch.setattr(Design, "settings_text", "radar: '*/ int x; ??/'\n")
    dc.generators.C().write(tmp_path / "code", make_radar(64, 16), small_window_chain())
    header = (tmp_path / "code" / "radar.h").read_text()
    comment = header[header.index("/* Settings of radar and chain") :]
    assert comment.index("*/") == len(comment) - 3
    assert "??/" not in comment  # a trigraph: the backslash that continues a line
