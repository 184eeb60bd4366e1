"""`dechirp`: find the command, run it, and say in one way what was wrong with the call.

A command is loaded when it is called. Exit status: 0 done, 1 it ran and the answer is no,
2 the call or its input is wrong, or what it prints cannot be written, 130 interrupted,
141 nobody reads what it prints.
"""

import io
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

from cyclopts import App, CycloptsError, Parameter

import dechirp
from dechirp.cli.short_memory import short_of_memory, too_little_to_start
from dechirp.cli.wrong import tell, wrong_call
from dechirp.core.errors import DechirpError, Mistake


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command line, that of the process without arguments; ends in SystemExit."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    _stand_in_for_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # not every terminal has a minus sign
    signal.signal(signal.SIGTERM, _end)
    try:
        status = _status(words)
        sys.stdout.flush()
    except KeyboardInterrupt as error:
        print(str(error) or "Interrupted; nothing was written.", file=sys.stderr)
        status = 128 + signal.SIGINT
    except BrokenPipeError:
        _give_up_streams()
        status = 128 + 13
    except OSError as error:
        if _streams_can_be_written():
            raise
        with suppress(OSError):
            tell([_unwritable(error)], as_json=False)
        _give_up_streams()
        status = 2
    raise SystemExit(status)


def _stand_in_for_closed_streams() -> None:
    """Print into nothing where a stream was closed, as by `>&-`; Python has None for it."""
    if sys.stdout is not None and sys.stderr is not None:
        return
    # Of the numbers 0 to 2 those that are free, or the next file would be printed to.
    while (nowhere := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(nowhere, True)  # the workers of `verify` start with them
    stand_in = os.fdopen(nowhere, "w", encoding="utf-8")
    sys.stdout = sys.stdout or stand_in
    sys.stderr = sys.stderr or stand_in


def _streams_can_be_written() -> bool:
    """Whether both streams take what is in their buffers, and one line more.

    A long text that failed is in no buffer; the line shows that its stream fails.
    """
    try:
        for end in ("", "\n"):
            for stream in (sys.stdout, sys.stderr):
                print(end=end, file=stream, flush=True)
    except OSError:
        return False
    return True


def _give_up_streams() -> None:
    """Let what is left to print go nowhere; Python would fail on it when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())


def _unwritable(error: OSError) -> Mistake:
    return Mistake(
        setting="standard output",
        got=f"not writable ({error.strerror or error})",
        need="a place that can be written and has room",
        fix="Send it elsewhere.",
    )


def _status(words: list[str]) -> int:
    as_json = any(word.startswith("--json") for word in words)  # --json=true is one, too
    if mistake := too_little_to_start():
        tell([mistake], as_json=as_json)
        return 2
    try:
        return int(app()(words, exit_on_error=False, print_error=False) or 0)
    except CycloptsError as error:
        tell(wrong_call(error), as_json=as_json)
    except DechirpError as error:
        tell(error.mistakes, as_json=as_json)
    except Exception as error:
        mistake = short_of_memory(error) or _nowhere(error)
        if mistake is None:
            raise
        tell([mistake], as_json=as_json)
    return 2


def _nowhere(error: Exception) -> Mistake | None:
    """What is wrong if the folder that the process is in has been removed."""
    if not isinstance(error, FileNotFoundError):
        return None
    with suppress(FileNotFoundError):
        Path.cwd()
        return None
    return Mistake(
        setting="the folder you are in",
        got="not there any more",
        need="one that is there",
        fix="Change to another, and call again.",
    )


def app() -> App:
    """Every command by its name; none is loaded yet."""
    made = App(
        name="dechirp",
        help="Design, simulate, process and prove FMCW radars. Without anything else,"
        " `dechirp run` shows a car at 50 m.",
        version=dechirp.__version__,
        help_format="plaintext",
        default_parameter=Parameter(negative=()),
        result_action="return_value",
        suppress_keyboard_interrupt=False,
    )
    made.command(
        "dechirp.cli.run:run",
        name="run",
        help="Simulate a scenario or read a recording, detect, and write a report.",
    )
    made.command(
        "dechirp.cli.design:design",
        name="design",
        help="Find the waveform that meets requirements, with every formula.",
    )
    made.command(
        "dechirp.cli.studio:studio",
        name="studio",
        help="Serve a web page on which a radar can be seen at work, and its knobs turned.",
    )
    made.command(
        "dechirp.cli.verify:verify",
        name="verify",
        help="Measure every claim of the reference report against theory, and write the paper.",
    )
    made.command(
        "dechirp.cli.study:study",
        name="study",
        help="Try a scenario many times over varied settings, with intervals, beside theory.",
    )
    made.command(
        "dechirp.cli.tune:tune",
        name="tune",
        help="Search detector, cluster and tracker settings for a stated aim.",
    )
    made.command(
        "dechirp.cli.inspect:inspect",
        name="inspect",
        help="Say what a recording is, what its radar can see, and what is wrong with it.",
    )
    made.command(
        "dechirp.cli.convert:convert",
        name="convert",
        help="Write a recording, a run or a simulated scene in the format of another tool.",
    )
    made.command(
        "dechirp.cli.calibrate:calibrate",
        name="calibrate",
        help="Measure gains and places of an array's elements with a reflector at known angles.",
    )
    made.command(
        "dechirp.cli.twin:twin",
        name="twin",
        help="Simulate a recording from what is found in it, and show both side by side.",
    )
    made.command(
        "dechirp.cli.fixed_point:fixed_point",
        name="fixed-point",
        help="Take one frame through the chain in words of given lengths; write test vectors.",
    )
    made.command(
        "dechirp.cli.list:list_members",
        name="list",
        help="List what settings choose by kind: detectors, impairments, formats.",
    )
    made.command(
        "dechirp.cli.schema:schema",
        name="schema",
        help="Print the JSON Schema of a settings file, for editors.",
    )
    made.command(
        "dechirp.cli.completion:completion",
        name="completion",
        help="Print the script by which a shell completes commands and options.",
    )
    made.command(
        "dechirp.cli.doctor:doctor",
        name="doctor",
        help="Check versions, extras, memory and compiled kernels.",
    )
    return made


def _end(signal_number: int, _frame: FrameType | None) -> NoReturn:
    # An exception, so that what is half written is cleared away.
    raise SystemExit(128 + signal_number)
