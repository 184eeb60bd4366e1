"""Ledger of a study: stored blocks, refusal of other studies, damage and full disks."""

import os
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import tiny_study
from dechirp.core.errors import DechirpError
from dechirp.core.findings import Finding
from dechirp.experiments.study.block import Block, Failure
from dechirp.experiments.study.executors import workers_from_executor
from dechirp.experiments.study.ledger import LOCK_NAME, Ledger
from dechirp.experiments.study.ledger_reader import LEDGER_NAME, LedgerReader
from nightly import nightly
from tiny_study import ENVIRONMENT, IDENTITY

NUMBERS = np.array([0.5, np.nan])


def open_ledger(out: Path, **settings) -> Ledger:
    return Ledger.create_or_continue(
        out, **{"identity": IDENTITY, "environment": ENVIRONMENT, **settings}
    )


def make_blocks(n: int, columns: int = 2) -> list[Block]:
    rng = np.random.default_rng(5)
    return [Block(0, i, 3 * i, rng.normal(size=(3, columns)), 0.5) for i in range(n)]


def test_added_blocks_are_read_back_in_trial_order(tmp_path):
    first, second = make_blocks(2)
    extreme_block = Block(
        7,
        0,
        0,
        np.array([[np.nan, -0.0], [5e-324, np.inf], [1 / 3, 1e308]]),
        0.25,
        (Failure(1, "ValueError: no"),),
        (),
        np.array([0.5, np.nan]),
    )
    with open_ledger(tmp_path) as ledger:
        ledger.add_blocks([second, extreme_block])
        ledger.add_blocks([first])
    with LedgerReader.open_read_only(tmp_path) as record:
        assert record.saved_point_and_block_numbers().tolist() == [[0, 0], [0, 1], [7, 0]]
        assert (
            record.trial_sums_of_point(0).tobytes()
            == np.concatenate([first.sums, second.sums]).tobytes()
        )
        assert record.trial_numbers_of_point(0).tolist() == [0, 1, 2, 3, 4, 5]
        assert record.trial_sums_of_point(7).tobytes() == extreme_block.sums.tobytes()
        assert [point for point, _ in record.iter_trial_sums_by_point()] == [0, 7]
        assert record.failed_trials_with_points() == [(7, Failure(1, "ValueError: no"))]
        np.testing.assert_array_equal(record.theoretical_values_of_point(7), [0.5, np.nan])
        assert record.theoretical_values_of_point(0) is None
        assert record.total_computing_seconds() == 1.25


def test_reader_returns_finished_blocks_while_study_runs(tmp_path):
    with open_ledger(tmp_path) as ledger, LedgerReader.open_read_only(tmp_path) as record:
        for n, block in enumerate(make_blocks(3)):
            assert len(record.saved_point_and_block_numbers()) == n
            ledger.add_blocks([block])
        assert len(record.trial_sums_of_point(0)) == 9


def test_blocks_past_end_of_point_are_dropped_with_their_failures(tmp_path):
    late = Block(0, 2, 6, np.full((3, 2), np.nan), 0.1, (Failure(6, "late"),))
    with open_ledger(tmp_path) as ledger:
        ledger.add_blocks([*make_blocks(2), late])
        ledger.end_point_and_delete_later_blocks(0, 1)
        assert ledger.saved_point_and_block_numbers().tolist() == [[0, 0]]
        assert ledger.n_blocks_of_points_ended_early() == {0: 1}
        assert ledger.count_failed_trials() == 0


def test_second_process_on_folder_is_refused_and_first_continues(tmp_path):
    with open_ledger(tmp_path) as ledger:
        second = subprocess.run(
            [sys.executable, tiny_study.__file__, tmp_path],
            capture_output=True,
            check=False,
            text=True,
            timeout=60,
        )
        assert second.returncode == 2
        assert "in use by another study that runs now" in second.stdout
        with pytest.raises(DechirpError, match="in use by another study"):
            open_ledger(tmp_path)
        ledger.add_blocks(make_blocks(1))
    with open_ledger(tmp_path) as ledger:  # closing releases the lock
        assert len(ledger.saved_point_and_block_numbers()) == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"study": "seed: 1\ntrials: 500"},
            r"study: trials: 500 \(line 2\); expected trials: 400 \(line 2\)",
        ),
        ({"study": "seed: 1"}, r"study: missing; expected trials: 400 \(line 2\)"),
        ({"dechirp": "0.2.0"}, r"dechirp: 0.2.0; expected 0.1.0.*--out.*remove"),
        ({"scenario": "car"}, r"scenario: car; expected missing"),
    ],
)
def test_different_study_is_refused_with_its_differences(tmp_path, changes, message):
    with open_ledger(tmp_path) as ledger:
        ledger.add_blocks(make_blocks(1))
    with pytest.raises(DechirpError, match=message):
        open_ledger(tmp_path, identity={**IDENTITY, **changes})
    with open_ledger(tmp_path) as ledger:  # the ledger is unchanged
        assert len(ledger.saved_point_and_block_numbers()) == 1


def test_all_differences_are_reported_together(tmp_path):
    open_ledger(tmp_path).close()
    with pytest.raises(DechirpError) as error:
        open_ledger(tmp_path, identity={"study": "seed: 2", "dechirp": "9"})
    assert [mistake.setting for mistake in error.value.mistakes] == ["study", "dechirp"]


def test_different_library_version_gives_finding(tmp_path):
    open_ledger(tmp_path).close()
    with open_ledger(tmp_path, environment={"numpy": "1.0"}) as ledger:
        (finding,) = ledger.environment_findings
        assert "now numpy 1.0, begun with numpy" in finding.value
        assert ledger.environments_of_all_runs == [ENVIRONMENT, {"numpy": "1.0"}]
    with open_ledger(tmp_path) as ledger:
        assert ledger.environment_findings == ()


def test_foreign_file_is_refused_and_left_unchanged(tmp_path):
    text, other_database, empty = tmp_path / "text", tmp_path / "other", tmp_path / "empty"
    for folder in (text, other_database, empty):
        folder.mkdir()
    (text / LEDGER_NAME).write_text("a shopping list, quite long enough to be no header")
    with closing(sqlite3.connect(other_database / LEDGER_NAME)) as connection, connection:
        connection.execute("CREATE TABLE songs (name TEXT)")
    connection.close()
    for folder, message in (
        (text, "no database"),
        (other_database, "a database of something else"),
    ):
        content = (folder / LEDGER_NAME).read_bytes()
        for opener in (open_ledger, LedgerReader.open_read_only):
            with pytest.raises(DechirpError, match=message):
                opener(folder)
        assert (folder / LEDGER_NAME).read_bytes() == content
    with pytest.raises(DechirpError, match="missing"):
        LedgerReader.open_read_only(empty)


def test_damaged_ledger_is_reported(tmp_path):
    with open_ledger(tmp_path) as ledger:
        ledger.add_blocks(make_blocks(400, columns=10))
    content = bytearray((tmp_path / LEDGER_NAME).read_bytes())
    content[4096:] = b"\xff" * (len(content) - 4096)
    (tmp_path / LEDGER_NAME).write_bytes(content)
    with pytest.raises(DechirpError, match="damaged"):
        open_ledger(tmp_path)


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE blocks SET sums = x'00'",
        "UPDATE blocks SET sums = 'a text'",
        "UPDATE blocks SET n_trials = 'three'",
        "UPDATE blocks SET n_trials = 0",
        "UPDATE blocks SET point = -1 WHERE number = 1",
        "UPDATE blocks SET first = 9223372036854775807",
        "UPDATE theory SET numbers = x'0011'",
        "UPDATE theory SET numbers = 7.5",
        "UPDATE failures SET message = x'ff'",
        "UPDATE findings SET level = 'nothing'",
        "INSERT INTO ended VALUES (0, 'all')",
        "UPDATE meta SET said = x'00' WHERE key = 'environments'",
        "UPDATE meta SET said = '[]' WHERE key = 'environments'",
        "UPDATE meta SET said = '[1]' WHERE key = 'environments'",
        "UPDATE meta SET said = '{\"name\": 5}' WHERE key = 'identity'",
        "DROP TABLE ended",
        "ALTER TABLE blocks RENAME COLUMN sums TO other",
    ],
)
def test_malformed_rows_are_reported_as_damage(statement, tmp_path):
    with open_ledger(tmp_path) as ledger:
        finding = Finding(level="note", setting="a", value="b", expected="c", fix="D.")
        failure = Failure(0, "ValueError: no")
        ledger.add_blocks(
            [*make_blocks(2), Block(1, 0, 0, np.ones((3, 2)), 0.5, (failure,), (finding,), NUMBERS)]
        )
    with closing(sqlite3.connect(tmp_path / LEDGER_NAME)) as connection, connection:
        connection.execute(statement)
    with pytest.raises(DechirpError, match="damaged"):
        open_ledger(tmp_path)
    with (
        pytest.raises(DechirpError, match="damaged"),
        LedgerReader.open_read_only(tmp_path) as record,
    ):
        assert not (record.study_identity, record.environments_of_all_runs)


def test_mismatched_sums_and_theory_are_reported_as_damage(tmp_path):
    with open_ledger(tmp_path) as ledger:
        ledger.add_blocks([Block(0, 0, 0, np.ones((3, 2)), 0.5, theory=NUMBERS)])
        ledger.check_sizes_of_sums_and_theory(n_columns=2, n_theoretical_values=2)
        for n_columns, n_laws in ((3, 2), (2, 1)):
            with pytest.raises(DechirpError, match="damaged"):
                ledger.check_sizes_of_sums_and_theory(
                    n_columns=n_columns, n_theoretical_values=n_laws
                )
        ledger.add_blocks([Block(0, 1, 3, np.ones((3, 5)), 0.5)])
        with pytest.raises(DechirpError, match="damaged"):
            ledger.trial_sums_of_point(0)


def test_ledger_of_later_format_is_refused(tmp_path):
    open_ledger(tmp_path).close()
    with closing(sqlite3.connect(tmp_path / LEDGER_NAME)) as connection, connection:
        connection.execute("UPDATE meta SET said = '2' WHERE key = 'format_version'")
    connection.close()
    with pytest.raises(DechirpError, match="format 2"):
        open_ledger(tmp_path)


@pytest.mark.skipif(
    os.name != "posix" or os.geteuid() == 0,
    reason="root can write to any folder: run as another user",
)
def test_rejects_folder_that_is_not_writable(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(DechirpError, match="not writable"):
        open_ledger(tmp_path)


def test_rejects_path_where_no_folder_can_be_created(tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(DechirpError, match="not writable"):
            open_ledger(path)


def test_full_disk_keeps_earlier_blocks_and_is_reported(tmp_path):
    with open_ledger(tmp_path) as ledger:
        ledger.add_blocks(make_blocks(1, columns=10))
        n_pages = ledger._connection.execute("PRAGMA page_count").fetchone()[0]
        ledger._connection.execute(f"PRAGMA max_page_count = {n_pages + 2}")
        with pytest.raises(DechirpError, match=r"full disk.*What was done before is kept"):
            ledger.add_blocks(make_blocks(2000, columns=10))
        assert len(ledger.saved_point_and_block_numbers()) == 1
    with open_ledger(tmp_path) as ledger:  # after space was freed
        ledger.add_blocks(make_blocks(2000, columns=10))
        assert len(ledger.saved_point_and_block_numbers()) == 2000


@nightly
@pytest.mark.skipif(os.name != "posix", reason="needs POSIX file size limits")
def test_study_stopped_by_file_size_limit_continues_to_same_result(tmp_path):
    def run_study(out: Path, *options: str) -> subprocess.CompletedProcess[str]:
        call = [sys.executable, tiny_study.__file__, out, *options]
        return subprocess.run(call, capture_output=True, check=False, text=True, timeout=60)

    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        tiny_study.run_tiny_study(tmp_path / "undisturbed", workers)
    process = run_study(tmp_path / "limited", "--file-limit", "60000")
    assert (process.returncode, process.stderr) == (2, "")
    assert "What was done before is kept" in process.stdout
    with LedgerReader.open_read_only(tmp_path / "limited") as record:
        assert 0 < len(record.saved_point_and_block_numbers()) < 324
    assert run_study(tmp_path / "limited").returncode == 0
    fingerprints = [
        tiny_study.ledger_digest(tmp_path / name) for name in ("undisturbed", "limited")
    ]
    assert fingerprints[0] == fingerprints[1]


def test_stale_lock_file_does_not_block(tmp_path):
    (tmp_path / LOCK_NAME).touch()
    open_ledger(tmp_path).close()
