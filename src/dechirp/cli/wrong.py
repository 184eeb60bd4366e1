"""What is wrong with a call or its input, in the words that all mistakes share."""

import json
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

from dechirp.config.nearest import OR_NONE, did_you_mean
from dechirp.config.shown import shown
from dechirp.core.errors import DechirpError, InvalidFile, Mistake

_KEYS = ("file", "line", "column", "setting", "got", "need", "fix")
_NEEDS: dict[Any, str] = {int: "a whole number", float: "a number", bool: "given without a value"}


def tell(mistakes: Iterable[Mistake], *, as_json: bool) -> None:
    """Say what is wrong: a line each on standard error, or one JSON document on standard output."""
    if not as_json:
        for mistake in mistakes:
            print(mistake, file=sys.stderr)
        return
    found = [asdict(mistake) for mistake in mistakes]
    print(json.dumps({"errors": [{key: one[key] for key in _KEYS} for one in found]}, indent=2))


def under_option(error: DechirpError, options: Mapping[str, str]) -> DechirpError:
    """Give the same error, with options in the place of the settings that came from them."""
    mistakes = []
    for mistake in error.mistakes:
        option = options.get(mistake.setting)
        if option is not None and mistake.file in (None, "--set"):
            # As a word of its own: `frame` is no part of `n_frames`.
            name = re.compile(rf"(?<![\w.]){re.escape(mistake.setting)}(?!\w)")
            fix = name.sub(option, mistake.fix)
            mistake = replace(  # noqa: PLW2901
                mistake, setting=option, fix=fix, file=None, line=None, column=None
            )
        mistakes.append(mistake)
    return InvalidFile(*mistakes)


def wrong_call(error: CycloptsError) -> list[Mistake]:
    """Say in our words what the parser of the command line found."""
    name = _name(error)
    help_fix = f"See {' '.join(['dechirp', *(error.command_chain or ())])} --help."
    match error:
        case UnknownCommandError(unused_tokens=[token, *_], app=App() as app):
            known = [word for word in app if not word.startswith("-")]
            mistake = Mistake(
                setting="the command",
                got=shown(token),
                need=f"one of {', '.join(known)}",
                fix=did_you_mean(token, known),
            )
        case UnknownOptionError(token=token):
            options = [
                word
                for argument in error.argument_collection
                for word in argument.names
                if word.startswith("--")
            ]
            given = token.keyword or token.value
            mistake = Mistake(
                setting=shown(given),
                got="not an option of this command",
                need=f"one of {', '.join(options)}" if options else "left out",
                fix=did_you_mean(given, options, OR_NONE) if options else help_fix,
            )
        case UnusedCliTokensError(unused_tokens=list() as tokens):
            mistake = Mistake(
                setting="the call",
                got=f"given {shown(' '.join(tokens))} more than it takes",
                need="without it",
                fix=f"Put names with spaces in quotes. {help_fix}",
            )
        case CoercionError(token=token, target_type=kind) if token is not None:
            choices = [str(c) for c in get_args(kind)] if get_origin(kind) is Literal else []
            need = f"one of {', '.join(choices)}" if choices else _NEEDS.get(kind, f"{kind}")
            fix = did_you_mean(token.value, choices) if choices else help_fix
            mistake = Mistake(setting=name, got=shown(token.value), need=need, fix=fix)
        case RepeatArgumentError():
            mistake = Mistake(
                setting=name, got="given twice", need="given once", fix="Keep one of them."
            )
        case MissingArgumentError():
            mistake = Mistake(
                setting=name, got="without a value", need="followed by one", fix=help_fix
            )
        case _:
            mistake = Mistake(
                setting="the call", got=shown(str(error)), need="as --help shows", fix=help_fix
            )
    return [mistake]


def _name(error: CycloptsError) -> str:
    """Option as it was written, or as it is called first."""
    token = getattr(error, "token", None)
    written = getattr(token, "keyword", None) or getattr(error, "keyword", None)
    if written:
        return str(written)
    return error.argument.name if error.argument is not None else "the call"
