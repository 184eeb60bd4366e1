"""Fuzzer of every entry point; each runs in its own process.

The fuzzer mutates the corpora of `tests/bad_input`. Every input must give a value, or an error of
dechirp with the setting, its value, the accepted values and a fix. Any other exception, more than
20 s for one input, or more than 2 GiB of memory in addition to the libraries is a failure: the
fuzzer stores the input in `fuzz-found/` and exits with status 1. After a fix, add the input to the
corpus.

    python fuzz/entries.py                           every entry point, 60 s each
    python fuzz/entries.py --seconds 600 dbc udp     two entry points, 600 s each
    python fuzz/entries.py --seed 7 --seconds 60     another sequence of mutations

With atheris (Linux) the fuzzer is guided by code coverage; without it, mutations are random.
"""

import argparse
import hashlib
import importlib.util
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from mutate import mutate

ROOT = Path(__file__).resolve().parents[1]
ARTIFACTS = Path("fuzz-found").absolute()
INPUT_TIMEOUT_S, EXTRA_MEMORY_BYTES = 20, 2 * 2**30
sys.path.insert(0, str(ROOT / "tests"))


def build_input_function(entry: str, folder: Path) -> Callable[[bytes, str], None]:
    """Build the function that replays the content of a file with a suffix."""
    from bad_input.entries import replay_input

    count = iter(range(10**12))

    def run_input(content: bytes, suffix: str) -> None:
        input_folder = folder / str(next(count))
        scratch = input_folder / "scratch"
        scratch.mkdir(parents=True)
        file = input_folder / f"input{suffix}"
        file.write_bytes(content)
        replay_input(entry, file, scratch)
        for path in sorted(input_folder.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
        input_folder.rmdir()

    return run_input


def fuzz_entry(entry: str, seconds: int, seed: int) -> None:
    """Fuzz one entry point and exit the process."""
    from bad_input.entries import CORPUS

    files = sorted((CORPUS / entry).iterdir())
    by_suffix: dict[str, list[bytes]] = {}
    for file in files:
        by_suffix.setdefault("".join(file.suffixes[-2:]), []).append(file.read_bytes())
    with tempfile.TemporaryDirectory() as name:
        run_input = build_input_function(entry, Path(name))
        for suffix, contents in by_suffix.items():
            for content in contents:
                run_input(content, suffix)
        _limit_memory()
        if importlib.util.find_spec("atheris"):
            _fuzz_with_coverage(entry, by_suffix, run_input, Path(name), seconds)
        else:
            _fuzz_randomly(entry, by_suffix, run_input, seconds, seed)


def _limit_memory() -> None:
    n_pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit_bytes = n_pages * os.sysconf("SC_PAGESIZE") + EXTRA_MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit_bytes, resource.RLIM_INFINITY))


def _fuzz_randomly(
    entry: str,
    by_suffix: dict[str, list[bytes]],
    run_input: Callable[[bytes, str], None],
    seconds: int,
    seed: int,
) -> None:
    """Mutate inputs until the time is over; store one input per failure signature."""
    rng = random.Random(f"{seed} {entry}")
    signal.signal(signal.SIGALRM, _raise_timeout)
    end_s, n, signatures = time.monotonic() + seconds, 0, set()
    while time.monotonic() < end_s:
        suffix = rng.choice(list(by_suffix))
        content = mutate(rng, by_suffix[suffix])
        signal.alarm(INPUT_TIMEOUT_S)
        try:
            run_input(content, suffix)
        except (Exception, SystemExit) as error:
            signature = _failure_signature(error)
            if signature not in signatures:
                signatures.add(signature)
                digest = hashlib.sha256(content).hexdigest()[:8]
                (ARTIFACTS / f"{entry}-{digest}{suffix}").write_bytes(content)
                print(f"-- {entry}-{digest}{suffix}", file=sys.stderr)
                traceback.print_exception(error, limit=-4)
        signal.alarm(0)
        n += 1
    print(f"executed_units: {n}", file=sys.stderr)
    raise SystemExit(1 if signatures else 0)


def _failure_signature(error: BaseException) -> str:
    """Return the signature of a failure: type, message and the last two lines of the traceback."""
    code = traceback.extract_tb(error.__traceback__)[-2:]
    message = re.sub(r"[\W\d_]+", " ", str(error))[:20]
    return f"{type(error).__name__} {message} {[(frame.filename, frame.lineno) for frame in code]}"


def _raise_timeout(_number: int, _frame: object) -> NoReturn:
    raise TimeoutError(f"input took more than {INPUT_TIMEOUT_S} s")


def _fuzz_with_coverage(
    entry: str,
    by_suffix: dict[str, list[bytes]],
    run_input: Callable[[bytes, str], None],
    folder: Path,
    seconds: int,
) -> None:
    """Fuzz with atheris; the first byte of an input selects the suffix."""
    import atheris

    corpus, suffixes = folder / "corpus", list(by_suffix)
    corpus.mkdir()
    for suffix_index, contents in enumerate(by_suffix.values()):
        for index, content in enumerate(contents):
            (corpus / f"{suffix_index}-{index}").write_bytes(bytes([suffix_index]) + content)
    atheris.instrument_all()

    def run_content(content: bytes) -> None:
        run_input(content[1:], suffixes[content[0] % len(suffixes)] if content else suffixes[0])

    limits = [f"-timeout={INPUT_TIMEOUT_S}", "-rss_limit_mb=3000", "-max_len=65536"]
    artifact_option = f"-artifact_prefix={ARTIFACTS}/{entry}-"
    time_option = f"-max_total_time={seconds}"
    atheris.Setup(
        [sys.argv[0], *limits, "-print_final_stats=1", artifact_option, time_option, str(corpus)],
        run_content,
    )
    atheris.Fuzz()


def main() -> None:
    from bad_input.entries import ENTRIES

    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "entries", nargs="*", metavar="entry", default=list(ENTRIES), help=", ".join(ENTRIES)
    )
    parser.add_argument("--seconds", type=int, default=60, help="time per entry point")
    parser.add_argument("--seed", type=int, default=1, help="seed of the mutations without atheris")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        fuzz_entry(options.entries[0], options.seconds, options.seed)
        return
    ARTIFACTS.mkdir(exist_ok=True)
    failed = False
    for entry in options.entries:
        child_options = ["--seconds", str(options.seconds), "--seed", str(options.seed)]
        command = [sys.executable, __file__, "--child", entry, *child_options]
        process = subprocess.run(command, check=False, capture_output=True, text=True)
        input_counts = re.findall(r"executed_units: *(\d+)", process.stderr)
        verdict = "failed" if process.returncode else "passed"
        print(f"{entry}: {verdict}, {''.join(input_counts) or 'no'} inputs", flush=True)
        if process.returncode:
            failed = True
            print(process.stderr[-20000:])
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
