"""The witness board: judgement of single numbers, missing files, and the command."""

import json

import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.witnesses.base import Comparison, Witness, compare_arrays
from dechirp.witnesses.board import (
    board_as_markdown,
    board_document,
    find_witness_data,
    run_witnesses,
    summarise_board,
)


def make_comparison(**changes):
    values = {
        "quantity": "level",
        "theirs": 2.0,
        "ours": 2.5,
        "unit": "W",
        "tolerance": 0.5,
        "basis": "a test",
    }
    return Comparison(**(values | changes))


@pytest.mark.parametrize(
    ("changes", "passed"),
    [
        ({}, True),
        ({"ours": 1.5}, True),
        ({"ours": 2.51}, False),
        ({"ours": np.nan}, False),
        ({"theirs": np.inf, "ours": np.inf}, False),
        ({"ours": 2.0, "tolerance": 0.0}, True),
        ({"ours": 9.0, "relation": "at least"}, True),
        ({"ours": 1.4, "relation": "at least"}, False),
        ({"ours": -9.0, "relation": "at most"}, True),
        ({"ours": 2.6, "relation": "at most"}, False),
    ],
)
def test_number_passes_within_its_tolerance(changes, passed):
    assert make_comparison(**changes).passed is passed


def test_array_is_judged_by_the_element_farthest_beyond_its_tolerance():
    def compare(ours):
        return compare_arrays(
            "levels", [1.0, 100.0, 0.0], ours, unit="1", basis="a test", relative=0.1, absolute=0.05
        )

    assert compare([1.1, 109.0, 0.05]).passed
    worst = compare([1.3, 109.0, 0.0])
    assert (worst.theirs, worst.ours, worst.passed) == (1.0, 1.3, False)
    assert not compare([1.0, np.nan, 0.0]).passed


@pytest.mark.parametrize(("theirs", "ours"), [([], []), ([1.0], [1.0, 2.0])])
def test_arrays_of_other_shapes_are_refused(theirs, ours):
    with pytest.raises(ValueError, match="theirs and ours of levels: arrays"):
        compare_arrays("levels", theirs, ours, unit="1", basis="a test")


class _Speaker:
    folder, source, licence = "speaker", "a test", "none"

    def __init__(self, error=None):
        self._error = error

    @staticmethod
    def kind():
        return "speaker"

    def compare(self, folder):
        yield make_comparison(answer="own")
        yield make_comparison(ours=9.0, cause="a known cause")
        if self._error is not None:
            raise self._error


def run_speaker(monkeypatch, folder, error=None):
    monkeypatch.setattr(Witness, "members", lambda: {"speaker": lambda: _Speaker(error)})
    (testimony,) = run_witnesses(folder)
    return testimony


def test_board_counts_numbers_and_names_causes(monkeypatch, tmp_path):
    (tmp_path / "speaker").mkdir()
    testimony = run_speaker(monkeypatch, tmp_path)

    document = board_document((testimony,))

    assert (document["n_witnesses"], document["n_numbers"], document["n_passed"]) == (1, 2, 1)
    assert document["passed"] is False
    title, _, _, _, good, bad, _, summary = board_as_markdown((testimony,)).splitlines()
    assert summary == document["summary"]
    assert title == "`speaker`: a test. Licence: none."
    assert good == "| level | own: 2 W | 2.5 W | 0.5 W: a test | passed |"
    assert bad == "| level | 2 W | 9 W | 0.5 W: a test | fails: a known cause |"


def test_missing_folder_and_file_are_listed_as_missing(monkeypatch, tmp_path):
    assert run_speaker(monkeypatch, tmp_path).missing == "folder speaker"
    (tmp_path / "speaker").mkdir()
    testimony = run_speaker(monkeypatch, tmp_path, FileNotFoundError("no levels.bin"))
    assert (testimony.missing, len(testimony.comparisons)) == ("no levels.bin", 2)
    assert "Missing: no levels.bin." in board_as_markdown((testimony,))


def test_error_of_a_witness_fails_the_board_and_keeps_its_numbers(monkeypatch, tmp_path):
    (tmp_path / "speaker").mkdir()
    testimony = run_speaker(monkeypatch, tmp_path, KeyError("column"))

    assert (testimony.passed, len(testimony.comparisons)) == (False, 2)
    assert "KeyError" in board_as_markdown((testimony,))


def test_summary_counts_own_decoding_apart_and_names_missing_sets(monkeypatch, tmp_path):
    (tmp_path / "speaker").mkdir()
    complete = run_speaker(monkeypatch, tmp_path)
    partly = run_speaker(monkeypatch, tmp_path, FileNotFoundError("no levels.bin"))
    broken = run_speaker(monkeypatch, tmp_path, KeyError("column"))

    assert summarise_board((complete,)) == (
        "0 of 1 independent answers agree, from 1 of 1 witnesses."
        " 1 of 1 answers of our own decoding agree."
    )
    assert summarise_board((complete, partly, broken)).endswith(
        " Missing, at least in part: speaker. Ended by an error, at least in part: speaker."
    )
    assert board_document((partly,))["missing"] == ["speaker"]


def test_command_names_missing_sets_in_its_last_line(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("DECHIRP_WITNESS_DATA", str(tmp_path))

    _, out, _ = run_cli(capsys, "verify", "--witnesses", "--out", str(tmp_path / "out"))

    last = " ".join(out.split()).rpartition("Missing, at least in part:")[2]
    assert last.strip(" .").split(", ") == [*Witness.members()]


def run_cli(capsys, *arguments):
    with pytest.raises(SystemExit) as exit_info:
        main(list(arguments))
    captured = capsys.readouterr()
    return exit_info.value.code, captured.out, captured.err


def test_command_needs_the_folder_of_the_witnesses(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("DECHIRP_WITNESS_DATA", str(tmp_path / "nothing"))

    status, _, error = run_cli(capsys, "verify", "--witnesses", "--out", str(tmp_path / "out"))

    assert (status, "DECHIRP_WITNESS_DATA" in error) == (2, True)
    assert not (tmp_path / "out").exists()


def test_command_refuses_options_of_the_certificate(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("DECHIRP_WITNESS_DATA", str(tmp_path))

    status, _, error = run_cli(capsys, "verify", "--witnesses", "--trials", "5")

    assert (status, "leave out --trials" in error) == (2, True)


def test_folder_without_witnesses_fails_with_all_listed_as_missing(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("DECHIRP_WITNESS_DATA", str(tmp_path))

    status, out, _ = run_cli(
        capsys, "verify", "--witnesses", "--json", "--out", str(tmp_path / "out")
    )

    document = json.loads(out)
    assert (status, document["n_numbers"]) == (1, 0)
    assert all(witness["missing"] for witness in document["witnesses"])
    board = (tmp_path / "out" / "witnesses.md").read_text(encoding="utf-8")
    assert board.count("Missing: folder") == len(Witness.members())


def test_error_names_the_variable_that_is_not_set(monkeypatch):
    monkeypatch.delenv("DECHIRP_WITNESS_DATA", raising=False)
    with pytest.raises(dc.InvalidSetting, match="DECHIRP_WITNESS_DATA: not set"):
        find_witness_data()
