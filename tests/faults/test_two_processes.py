"""Two processes that write to one path: one is refused or the last one wins, never a mixture."""

import json

from dechirp.core.atomic_files import atomic_file, atomic_folder
from faults.conftest import run_shell
from nightly import nightly


def test_last_of_two_folders_is_complete(tmp_path):
    out = tmp_path / "out"
    with atomic_folder(out) as first:
        (first / "mine").write_text("first")
        with atomic_folder(out) as second:
            (second / "mine").write_text("second")
        (first / "also").write_text("first")

    assert {path.name: path.read_text() for path in out.iterdir()} == {
        "mine": "first",
        "also": "first",
    }
    assert list(tmp_path.iterdir()) == [out]


def test_last_of_two_files_is_complete(tmp_path):
    out = tmp_path / "out.json"
    with atomic_file(out) as first:
        first.write_text("first, and longer")
        with atomic_file(out) as second:
            second.write_text("second")

    assert out.read_text() == "first, and longer"
    assert list(tmp_path.iterdir()) == [out]


@nightly
def test_concurrent_runs_leave_results_of_one_run(folder):
    line = " ".join(f'"$@" --seed {seed} & p{seed}=$!;' for seed in range(4))
    line += " ".join(f"wait $p{seed}; echo $?;" for seed in range(4))
    process = run_shell(line, "run", "small.yaml", "--out", "out", "--quiet")

    statuses = [int(word) for word in process.stdout.split()]
    assert set(statuses) <= {0, 2}
    assert 0 in statuses
    assert len(process.stderr.splitlines()) == statuses.count(2)
    seed = json.loads((folder / "out" / "run.json").read_text())["seed"]
    assert f"seed: {seed}\n" in (folder / "out" / "scenario.yaml").read_text()
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


@nightly
def test_second_study_is_refused_and_first_continues(folder):
    line = '("$@" & first=$!; "$@"; echo $?; wait $first; echo $?) | sort'
    arguments = ("study", "study.yaml", "--workers", "1", "--out", "out", "--quiet")
    process = run_shell(line, *arguments, "--set", "trials.at_most=400")

    assert process.stdout.split() == ["0", "2"]
    assert "in use by another study that runs now" in process.stderr
