"""What a study keeps, and what it refuses to mix with it."""

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
from tiny_study import ENVIRONMENT, IDENTITY

NUMBERS = np.array([0.5, np.nan])


def opened(out: Path, **told) -> Ledger:
    return Ledger.open(out, **{"identity": IDENTITY, "environment": ENVIRONMENT, **told})


def blocks(n: int, columns: int = 2) -> list[Block]:
    rng = np.random.default_rng(5)
    return [Block(0, i, 3 * i, rng.normal(size=(3, columns)), 0.5) for i in range(n)]


def test_what_was_added_is_read_back_to_the_bit_in_the_order_of_the_trials(tmp_path):
    first, second = blocks(2)
    odd = Block(
        7,
        0,
        0,
        np.array([[np.nan, -0.0], [5e-324, np.inf], [1 / 3, 1e308]]),
        0.25,
        (Failure(1, "ValueError: no"),),
        (),
        np.array([0.5, np.nan]),
    )
    with opened(tmp_path) as ledger:
        ledger.add_blocks([second, odd])
        ledger.add_blocks([first])
    with LedgerReader.open_existing(tmp_path) as record:
        assert record.finished_blocks().tolist() == [[0, 0], [0, 1], [7, 0]]
        assert record.point_sums(0).tobytes() == np.concatenate([first.sums, second.sums]).tobytes()
        assert record.trial_numbers(0).tolist() == [0, 1, 2, 3, 4, 5]
        assert record.point_sums(7).tobytes() == odd.sums.tobytes()
        assert [point for point, _ in record.iter_point_sums()] == [0, 7]
        assert record.failures() == [(7, Failure(1, "ValueError: no"))]
        np.testing.assert_array_equal(record.point_theory(7), [0.5, np.nan])
        assert record.point_theory(0) is None
        assert record.total_seconds() == 1.25


def test_a_reader_sees_finished_blocks_while_the_study_runs(tmp_path):
    with opened(tmp_path) as ledger, LedgerReader.open_existing(tmp_path) as record:
        for n, block in enumerate(blocks(3)):
            assert len(record.finished_blocks()) == n
            ledger.add_blocks([block])
        assert len(record.point_sums(0)) == 9


def test_blocks_past_the_end_of_a_point_are_dropped_with_their_failures(tmp_path):
    late = Block(0, 2, 6, np.full((3, 2), np.nan), 0.1, (Failure(6, "late"),))
    with opened(tmp_path) as ledger:
        ledger.add_blocks([*blocks(2), late])
        ledger.end_point(0, 1)
        assert ledger.finished_blocks().tolist() == [[0, 0]]
        assert ledger.ended_points() == {0: 1}
        assert ledger.count_failures() == 0


def test_a_second_process_on_one_folder_is_refused_and_the_first_one_goes_on(tmp_path):
    with opened(tmp_path) as ledger:
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
            opened(tmp_path)
        ledger.add_blocks(blocks(1))
    with opened(tmp_path) as ledger:  # closed is free again
        assert len(ledger.finished_blocks()) == 1


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (
            {"study": "seed: 1\ntrials: 500"},
            r"study: trials: 500 \(line 2\); expected trials: 400 \(line 2\)",
        ),
        ({"study": "seed: 1"}, r"study: absent; expected trials: 400 \(line 2\)"),
        ({"dechirp": "0.2.0"}, r"dechirp: 0.2.0; expected 0.1.0.*--out.*remove"),
        ({"scenario": "car"}, r"scenario: car; expected absent"),
    ],
)
def test_another_study_is_refused_with_what_differs(tmp_path, asked, says):
    with opened(tmp_path) as ledger:
        ledger.add_blocks(blocks(1))
    with pytest.raises(DechirpError, match=says):
        opened(tmp_path, identity={**IDENTITY, **asked})
    with opened(tmp_path) as ledger:  # and nothing has changed
        assert len(ledger.finished_blocks()) == 1


def test_all_that_differs_is_said_at_once(tmp_path):
    opened(tmp_path).close()
    with pytest.raises(DechirpError) as refused:
        opened(tmp_path, identity={"study": "seed: 2", "dechirp": "9"})
    assert [mistake.setting for mistake in refused.value.mistakes] == ["study", "dechirp"]


def test_another_library_is_a_doubt_and_no_refusal(tmp_path):
    opened(tmp_path).close()
    with opened(tmp_path, environment={"numpy": "1.0"}) as ledger:
        (doubt,) = ledger.environment_findings
        assert "now numpy 1.0, begun with numpy" in doubt.value
        assert ledger.environments == [ENVIRONMENT, {"numpy": "1.0"}]
    with opened(tmp_path) as ledger:
        assert ledger.environment_findings == ()


def test_a_file_that_is_something_else_is_refused_and_left_alone(tmp_path):
    text, other, empty = tmp_path / "text", tmp_path / "other", tmp_path / "empty"
    for folder in (text, other, empty):
        folder.mkdir()
    (text / LEDGER_NAME).write_text("a shopping list, quite long enough to be no header")
    with closing(sqlite3.connect(other / LEDGER_NAME)) as connection, connection:
        connection.execute("CREATE TABLE songs (name TEXT)")
    connection.close()
    for folder, says in ((text, "no database"), (other, "a database of something else")):
        before = (folder / LEDGER_NAME).read_bytes()
        for open_it in (opened, LedgerReader.open_existing):
            with pytest.raises(DechirpError, match=says):
                open_it(folder)
        assert (folder / LEDGER_NAME).read_bytes() == before
    with pytest.raises(DechirpError, match="not there"):
        LedgerReader.open_existing(empty)


def test_a_damaged_record_is_said_to_be_damaged(tmp_path):
    with opened(tmp_path) as ledger:
        ledger.add_blocks(blocks(400, columns=10))
    content = bytearray((tmp_path / LEDGER_NAME).read_bytes())
    content[4096:] = b"\xff" * (len(content) - 4096)
    (tmp_path / LEDGER_NAME).write_bytes(content)
    with pytest.raises(DechirpError, match="damaged"):
        opened(tmp_path)


@pytest.mark.parametrize(
    "tampered",
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
def test_rows_that_are_not_ours_are_said_to_be_damage(tampered, tmp_path):
    with opened(tmp_path) as ledger:
        said = Finding(level="note", setting="a", value="b", expected="c", fix="D.")
        failure = Failure(0, "ValueError: no")
        ledger.add_blocks(
            [*blocks(2), Block(1, 0, 0, np.ones((3, 2)), 0.5, (failure,), (said,), NUMBERS)]
        )
    with closing(sqlite3.connect(tmp_path / LEDGER_NAME)) as connection, connection:
        connection.execute(tampered)
    with pytest.raises(DechirpError, match="damaged"):
        opened(tmp_path)
    with (
        pytest.raises(DechirpError, match="damaged"),
        LedgerReader.open_existing(tmp_path) as record,
    ):
        assert not (record.identity, record.environments)


def test_trials_of_other_sums_and_points_of_other_theory_are_damage(tmp_path):
    with opened(tmp_path) as ledger:
        ledger.add_blocks([Block(0, 0, 0, np.ones((3, 2)), 0.5, theory=NUMBERS)])
        ledger.check_columns(n_columns=2, n_laws=2)
        for n_columns, n_laws in ((3, 2), (2, 1)):
            with pytest.raises(DechirpError, match="damaged"):
                ledger.check_columns(n_columns=n_columns, n_laws=n_laws)
        ledger.add_blocks([Block(0, 1, 3, np.ones((3, 5)), 0.5)])
        with pytest.raises(DechirpError, match="damaged"):
            ledger.point_sums(0)


def test_a_record_of_a_later_format_is_refused(tmp_path):
    opened(tmp_path).close()
    with closing(sqlite3.connect(tmp_path / LEDGER_NAME)) as connection, connection:
        connection.execute("UPDATE meta SET said = '2' WHERE key = 'format_version'")
    connection.close()
    with pytest.raises(DechirpError, match="in format 2"):
        opened(tmp_path)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root writes everywhere")
def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(DechirpError, match="not writable"):
        opened(tmp_path)


def test_a_place_where_no_folder_can_be_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(DechirpError, match="not writable"):
            opened(place)


def test_a_full_disk_keeps_what_was_there_and_says_so(tmp_path):
    with opened(tmp_path) as ledger:
        ledger.add_blocks(blocks(1, columns=10))
        n_pages = ledger._connection.execute("PRAGMA page_count").fetchone()[0]
        ledger._connection.execute(f"PRAGMA max_page_count = {n_pages + 2}")
        with pytest.raises(DechirpError, match=r"full disk.*What was done before is kept"):
            ledger.add_blocks(blocks(2000, columns=10))
        assert len(ledger.finished_blocks()) == 1
    with opened(tmp_path) as ledger:  # with room again
        ledger.add_blocks(blocks(2000, columns=10))
        assert len(ledger.finished_blocks()) == 2000


@pytest.mark.skipif(os.name != "posix", reason="limits of file sizes are those of POSIX")
def test_a_study_that_runs_into_a_limit_of_its_disk_goes_on_with_the_same_result(tmp_path):
    def run(out: Path, *options: str) -> subprocess.CompletedProcess[str]:
        call = [sys.executable, tiny_study.__file__, out, *options]
        return subprocess.run(call, capture_output=True, check=False, text=True, timeout=60)

    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        tiny_study.run(tmp_path / "undisturbed", workers)
    limited = run(tmp_path / "limited", "--file-limit", "60000")
    assert (limited.returncode, limited.stderr) == (2, "")
    assert "What was done before is kept" in limited.stdout
    with LedgerReader.open_existing(tmp_path / "limited") as record:
        assert 0 < len(record.finished_blocks()) < 324
    assert run(tmp_path / "limited").returncode == 0
    ends = [tiny_study.fingerprint(tmp_path / name) for name in ("undisturbed", "limited")]
    assert ends[0] == ends[1]


def test_the_lock_is_no_obstacle_when_it_is_left_behind(tmp_path):
    (tmp_path / LOCK_NAME).touch()
    opened(tmp_path).close()
