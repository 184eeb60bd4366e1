"""Fixes of error messages, translated from command-line options to page controls."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from dechirp.core.errors import DechirpError
from dechirp.core.findings import Finding

_PYTHON_HINT = re.compile(r" \(\w+=[^()]*\)")
_RADAR_CHOICE = "settings of its radar, under Recordings"
_PANEL_BY_OPTION = (
    ("give the radar: --radar FILE", f"choose {_RADAR_CHOICE}"),
    ("give its settings: --radar FILE", f"choose {_RADAR_CHOICE}"),
    ("give the one of this recording", f"choose the one of this recording as {_RADAR_CHOICE}"),
    ("with --radar", f"as {_RADAR_CHOICE}"),
    ("--radar FILE", _RADAR_CHOICE),
    ("run with --calibration", "set --calibration"),
)
_RADAR_OPTION = re.compile(r"(?<!RECORDING )--radar (?:'([^']*)'|([^\s,;]+))")
_RECORDING_OPTION = re.compile(
    r"--(axes|calibration|device|encoding|format|frames|iq)\b(?: ([\w,-]+(?:\.\w+)*))?"
)
_SET_OPTION = re.compile(r"--set (?:'([^']*)'|(\S+))")


def translate_cli_fix_to_page(fix: str) -> str:
    """Translate a fix to the panels of the page, else to settings of the file."""
    fix = _PYTHON_HINT.sub("", fix)
    for option, panel in _PANEL_BY_OPTION:
        fix = fix.replace(option, panel)
    fix = _RADAR_OPTION.sub(lambda option: option[1] or option[2], fix)
    fix = _SET_OPTION.sub(lambda option: f"{option[1] or option[2]} (under File)", fix)
    return _RECORDING_OPTION.sub(_option_as_recording_setting, fix)


def translate_finding_to_page(finding: Finding) -> Finding:
    """Translate the options in a finding: chosen ones to settings, a fix to the page's panels."""
    value = _SET_OPTION.sub(lambda option: option[1] or option[2], finding.value)
    value = _RECORDING_OPTION.sub(
        lambda option: f"recording.{option[1]}{f'={option[2]}' if option[2] else ''}", value
    )
    return replace(finding, value=value, fix=translate_cli_fix_to_page(finding.fix))


def _option_as_recording_setting(option_match: re.Match[str]) -> str:
    name, value = option_match.groups()
    return f"recording.{name}{f': {value}' if value else ''} (under File)"


@contextmanager
def translate_error_fixes_to_page() -> Iterator[None]:
    """Translate the fixes of errors raised inside the block to the page."""
    try:
        yield
    except DechirpError as error:
        mistakes = (
            replace(mistake, fix=translate_cli_fix_to_page(mistake.fix))
            for mistake in error.mistakes
        )
        raise DechirpError(*mistakes) from None
