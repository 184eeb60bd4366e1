"""Entry point of the command line: find a command, run it and report errors uniformly.

A command is imported when it is called. Exit status: 0 success; 1 the command ran and its answer
is no; 2 an invalid call or input, or output that cannot be written; 130 interrupted; 141 the
reader of the output has closed it; 143 ended by SIGTERM.
"""

import atexit
import gc
import inspect
import io
import os
import re
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from cyclopts import App, CycloptsError, Parameter

import dechirp
from dechirp.cli import commands
from dechirp.cli.compilation_notice import announced_compilation
from dechirp.cli.errors import (
    low_memory_limit_mistake,
    memory_error_to_mistake,
    parser_error_to_mistakes,
    print_errors,
)
from dechirp.cli.signals import interrupted_by_signals
from dechirp.core.atomic_files import completed_outputs
from dechirp.core.errors import DechirpError, Mistake, quote_for_message


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command line (by default that of the process) and raise SystemExit."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    _collect_garbage_rarely()
    _replace_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # not every terminal has a minus sign
    n_earlier_outputs = len(completed_outputs())
    received_signals: list[int] = []
    try:
        with interrupted_by_signals() as received_signals:
            status = _run_command(words, received_signals)
            sys.stdout.flush()
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt) or received_signals:
            message = str(error) if isinstance(error, KeyboardInterrupt) else ""
            outputs = completed_outputs()[n_earlier_outputs:]
            print(message or _describe_interrupt(outputs), file=sys.stderr)
            status = 128 + (received_signals or [signal.SIGINT])[0]
        elif isinstance(error, OSError):
            status = _handle_output_error(error)
        else:
            raise
    raise SystemExit(status)


def _handle_output_error(error: OSError) -> int:
    """Return the status after an error of the standard streams; raise any other error again."""
    if isinstance(error, BrokenPipeError):
        _discard_remaining_output()
        return 128 + 13
    if _can_write_streams():
        raise error
    with suppress(OSError):
        print_errors([_unwritable_output_mistake(error)], as_json=False)
    _discard_remaining_output()
    return 2


def _collect_garbage_rarely() -> None:
    """Let the garbage collector of cycles skip the many objects that libraries create for good.

    Of the 1.9 s CPU of `dechirp inspect`, collections during imports took 0.1 s, and 0.3 s those at
    exit, which free memory that the system frees anyway. `dechirp run` creates 0.4 million objects
    that stay. Processing leaves no cycles that hold arrays (none in 160 frames).
    """
    gc.set_threshold(500_000)
    atexit.register(_skip_collection_at_exit)


def _skip_collection_at_exit() -> None:
    if "duckdb" not in sys.modules:  # version 2 prints each of its objects that remains, 23 lines
        gc.freeze()


def _describe_interrupt(outputs: Sequence[Path]) -> str:
    """Describe an interrupted command by the outputs that are already in place."""
    names = ", ".join(map(str, outputs))
    return f"Interrupted; complete: {names}." if outputs else "Interrupted; nothing was written."


def _replace_closed_streams() -> None:
    """Replace closed standard streams (`>&-`), which Python sets to None, by the null device."""
    if sys.stdout is not None and sys.stderr is not None:
        return
    # Occupy free descriptors from 0 to 2; otherwise the next opened file would be printed to.
    while (nowhere := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(nowhere, True)  # inherited by worker processes
    stand_in = os.fdopen(nowhere, "w", encoding="utf-8")
    sys.stdout = sys.stdout or stand_in
    sys.stderr = sys.stderr or stand_in


def _can_write_streams() -> bool:
    """Return True if both standard streams accept their buffers and one more line.

    A long text that failed is in no buffer, from Python 3.14 on no text that failed; only the
    additional line reveals the failure. Errors go first: results must not end with that line.
    """
    try:
        for end in ("", "\n"):
            for stream in (sys.stderr, sys.stdout):
                print(end=end, file=stream, flush=True)
    except OSError:
        return False
    return True


def _discard_remaining_output() -> None:
    """Redirect the remaining output to the null device; Python would fail on it at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())


def _unwritable_output_mistake(error: OSError) -> Mistake:
    return Mistake(
        setting="standard output",
        value=f"not writable ({error.strerror or error})",
        expected="a place that can be written and has room",
        fix="redirect it elsewhere",
    )


def _run_command(words: list[str], received_signals: Sequence[int]) -> int:
    """Run a command, print its errors, and return its status; after a signal errors are raised."""
    as_json = any(word.startswith("--json") for word in words)  # includes --json=true
    if mistake := low_memory_limit_mistake():
        print_errors([mistake], as_json=as_json)
        return 2
    if mistake := _empty_argument_mistake(words):
        print_errors([mistake], as_json=as_json)
        return 2
    try:
        with announced_compilation(quiet="--quiet" in words):
            return int(build_command_line_app()(words, exit_on_error=False, print_error=False) or 0)
    except Exception as error:
        mistakes = [] if received_signals else _mistakes_of_error(error)
        if not mistakes:
            raise
        print_errors(mistakes, as_json=as_json)
    return 2


def _empty_argument_mistake(words: Sequence[str]) -> Mistake | None:
    """Return the mistake if an argument is empty, as by an empty variable of a shell, else None.

    An empty path would be the current folder, from which recordings are read and into which
    results are written.
    """
    for index, word in enumerate(words):
        option, equals, value = word.partition("=")
        is_empty_option = option.startswith("--") and bool(equals) and not value
        if word.strip() and not is_empty_option:
            continue
        previous = quote_for_message(words[index - 1]) if index else "dechirp"
        return Mistake(
            setting=option if is_empty_option else "command line",
            value="an empty value" if is_empty_option else f"an empty argument after {previous}",
            expected="a name or a value",
            fix="give it, or check for an empty variable of the shell; . is the current folder",
        )
    return None


def _mistakes_of_error(error: Exception) -> Sequence[Mistake]:
    """Return the mistakes of the user that an error reports; none for an unexpected error."""
    if isinstance(error, CycloptsError):
        return parser_error_to_mistakes(error)
    if isinstance(error, DechirpError):
        return error.mistakes
    mistake = memory_error_to_mistake(error) or _removed_working_folder_mistake(error)
    return [] if mistake is None else [mistake]


def _removed_working_folder_mistake(error: Exception) -> Mistake | None:
    """Return the mistake if the working folder has been removed, else None."""
    if not isinstance(error, FileNotFoundError):
        return None
    with suppress(FileNotFoundError):
        Path.cwd()
        return None
    return Mistake(
        setting="working folder",
        value="removed",
        expected="an existing folder",
        fix="change to another folder and repeat the call",
    )


def build_command_line_app() -> App:
    """Return the command line with all commands; none of them is imported yet."""
    command_line = App(
        name="dechirp",
        help="Design, simulate, process and verify FMCW radars. Start with `dechirp run`, which"
        " detects a car at 50 m.",
        version=dechirp.__version__,
        help_format="markdown",
        default_parameter=Parameter(negative=()),
        result_action="return_value",
        suppress_keyboard_interrupt=False,
    )
    for file in sorted(Path(commands.__path__[0]).glob("[a-z]*.py")):
        function, description = _read_command_name_and_help(file)
        command_line.command(
            f"{commands.__name__}.{file.stem}:{function}",
            name=file.stem.replace("_", "-"),
            help=description,
        )
    return command_line


def _read_command_name_and_help(file: Path) -> tuple[str, str]:
    """Read the name and the description of the first function of a command file.

    Searching 15 files takes 1 ms, parsing them 20; importing them, with NumPy and xarray, a second.
    """
    found = re.search(
        r'^def (\w+)\(.*?"""(.*?)\s*("""|\n +Parameters\n)',
        file.read_text(encoding="utf-8"),
        re.DOTALL | re.MULTILINE,
    )
    assert found is not None
    return found[1], inspect.cleandoc(found[2])
