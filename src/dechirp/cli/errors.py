"""Error messages of the command line."""

import errno
import json
import os
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from typing import Any, Literal, get_args, get_origin

from cyclopts import (
    App,
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    RepeatArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from dechirp.core.errors import DechirpError, InvalidFile, Mistake, quote_for_message
from dechirp.core.suggestions import CHOOSE_OR_OMIT, did_you_mean_fix

# The libraries alone reserve 0.65 GB of addresses with one thread and 0.06 GB more per thread.
# With less, one of them retries for ever and raises no exception.
MIN_BYTES = 768 * 2**20
BYTES_PER_THREAD = 64 * 2**20
_FIX = (
    "raise the limit (`ulimit -v`), or process less at once: fewer frames, chirps, channels,"
    " workers or threads (OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1)"
)
_MEMORY_MESSAGES = ("can't start new thread", "cannot allocate memory", "failed to map segment")


def low_memory_limit_mistake() -> Mistake | None:
    """Return the mistake if the memory limit is too small to load the libraries, else None."""
    limit = _address_space_limit_bytes()
    least = MIN_BYTES + _n_blas_threads() * BYTES_PER_THREAD
    if limit is None or limit >= least:
        return None
    return Mistake(
        setting="memory limit",
        value=_format_gib(limit),
        expected=f"at least {_format_gib(least)} for the libraries with {_n_blas_threads()}"
        " threads",
        fix=_FIX,
    )


def memory_error_to_mistake(error: Exception) -> Mistake | None:
    """Return the mistake if an exception means a lack of memory, else None."""
    is_short = isinstance(error, MemoryError) or (
        isinstance(error, OSError) and error.errno == errno.ENOMEM
    )
    if not is_short and not any(words in str(error).lower() for words in _MEMORY_MESSAGES):
        return None
    limit = _address_space_limit_bytes()
    return Mistake(
        setting="memory",
        value=f"used up ({error})" if str(error) else "used up",
        expected="enough memory" + (f"; the limit is {_format_gib(limit)}" if limit else ""),
        fix=_FIX,
    )


def _address_space_limit_bytes() -> int | None:
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def _n_blas_threads() -> int:
    variable = os.environ.get("OPENBLAS_NUM_THREADS", "")
    return int(variable) if variable.isdecimal() else os.cpu_count() or 1


def _format_gib(n_bytes: float) -> str:
    return f"{n_bytes / 2**30:.3g} GiB"


_JSON_KEYS = ("file", "line", "column", "setting", "value", "expected", "fix")
# Words of the literature for families whose names do not resemble them.
_CHOICE_BY_SYNONYM = {
    "detector": "cfar",
    "detectors": "cfar",
    "detection": "cfar",
    "direction": "angle",
    "directions": "angle",
    "interference": "mitigation",
    "clutter": "mitigation",
    "antenna": "pattern",
    "antennas": "pattern",
    "board": "device",
    "chip": "device",
    "reader": "format",
    "readers": "format",
}
_EXPECTED_BY_TYPE: dict[Any, str] = {
    int: "an integer",
    float: "a number",
    bool: "no value",
}


def print_errors(mistakes: Iterable[Mistake], *, as_json: bool) -> None:
    """Print each mistake on standard error, or all as one JSON document on standard output."""
    if not as_json:
        for mistake in mistakes:
            print(mistake, file=sys.stderr)
        return
    documents = [asdict(mistake) for mistake in mistakes]
    print(
        json.dumps(
            {"errors": [{key: document[key] for key in _JSON_KEYS} for document in documents]},
            indent=2,
        )
    )


def replace_settings_by_options(
    error: DechirpError, option_by_setting: Mapping[str, str]
) -> DechirpError:
    """Return the same error with option names in place of the settings that they set."""
    mistakes = []
    for mistake in error.mistakes:
        option = option_by_setting.get(mistake.setting)
        if option is not None and mistake.file in (None, "--set"):
            # Whole words only: `frame` is not part of `n_frames`.
            name = re.compile(rf"(?<![\w.]){re.escape(mistake.setting)}(?!\w)")
            fix = name.sub(option, mistake.fix)
            mistake = replace(  # noqa: PLW2901
                mistake, setting=option, fix=fix, file=None, line=None, column=None
            )
        mistakes.append(mistake)
    return InvalidFile(*mistakes)


def parser_error_to_mistakes(error: CycloptsError) -> list[Mistake]:
    """Convert an error of the command-line parser to mistakes."""
    setting = _option_as_typed(error)
    help_fix = f"see {' '.join(['dechirp', *(error.command_chain or ())])} --help"
    match error:
        case UnknownCommandError(unused_tokens=[token, *_], app=App() as app):
            commands = [word for word in app if not word.startswith("-")]
            mistake = Mistake(
                setting="command",
                value=quote_for_message(token),
                expected=f"one of {', '.join(commands)}",
                fix=did_you_mean_fix(token, commands),
            )
        case UnknownOptionError(token=token):
            options = [
                word
                for argument in error.argument_collection
                for word in argument.names
                if word.startswith("--")
            ]
            option = token.keyword or token.value
            mistake = Mistake(
                setting=quote_for_message(option),
                value="not an option of this command",
                expected=f"one of {', '.join(options)}" if options else "no options",
                fix=did_you_mean_fix(option, options, CHOOSE_OR_OMIT) if options else help_fix,
            )
        case UnusedCliTokensError(unused_tokens=list() as tokens):
            mistake = Mistake(
                setting="command line",
                value=f"unexpected argument {quote_for_message(' '.join(tokens))}",
                expected="no further argument",
                fix=f"quote names with spaces, or {help_fix}",
            )
        case CoercionError(token=token, target_type=kind) if token is not None:
            choices = [str(c) for c in get_args(kind)] if get_origin(kind) is Literal else []
            expected = (
                f"one of {', '.join(choices)}"
                if choices
                else _EXPECTED_BY_TYPE.get(kind, f"{kind}")
            )
            word = _CHOICE_BY_SYNONYM.get(token.value.lower(), token.value)
            fix = did_you_mean_fix(word, choices) if choices else help_fix
            mistake = Mistake(
                setting=setting, value=quote_for_message(token.value), expected=expected, fix=fix
            )
        case RepeatArgumentError():
            mistake = Mistake(
                setting=setting, value="given twice", expected="one value", fix="keep one of them"
            )
        case MissingArgumentError():
            mistake = Mistake(setting=setting, value="no value", expected="a value", fix=help_fix)
        case _:
            mistake = Mistake(
                setting="command line",
                value=quote_for_message(str(error)),
                expected="a call as shown by --help",
                fix=help_fix,
            )
    return [mistake]


def _option_as_typed(error: CycloptsError) -> str:
    """Return the option as the user wrote it, else its first name."""
    token = getattr(error, "token", None)
    keyword = getattr(token, "keyword", None) or getattr(error, "keyword", None)
    if keyword:
        return str(keyword)
    return error.argument.name if error.argument is not None else "command line"
