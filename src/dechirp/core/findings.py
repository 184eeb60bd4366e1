"""Findings: notes, warnings and errors about a result that is nevertheless valid."""

import logging
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Literal, Self

from dechirp.core.display import Table
from dechirp.core.errors import Mistake
from dechirp.core.values import frozen_dataclass


@frozen_dataclass
class Finding:
    """Unmet requirement or surprising physics: setting, value, expectation and fix."""

    level: Literal["note", "warning", "error"]
    setting: str
    value: str
    expected: str
    fix: str

    @classmethod
    def from_mistake(cls, mistake: Mistake, *, level: Literal["warning", "error"]) -> Self:
        """Create a finding from a mistake, without its location in a file."""
        return cls(
            level=level,
            setting=mistake.setting,
            value=mistake.value,
            expected=mistake.expected,
            fix=mistake.fix,
        )

    def __str__(self) -> str:
        return f"{self.setting}: {self.value}; expected {self.expected}; {self.fix}"


def findings_display_table(findings: Iterable[Finding]) -> Table:
    """Return the table of findings that a notebook shows."""
    return Table("Findings", [(finding.level, str(finding)) for finding in findings])


def log_findings(logger: logging.Logger, findings: Iterable[Finding]) -> None:
    """Log findings: notes as information, warnings and errors at their levels."""
    levels = {"note": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
    for finding in findings:
        logger.log(levels[finding.level], "%s", finding)


class PhysicsWarning(UserWarning):
    """Valid but surprising physics, such as an aliased or a late echo.

    Its argument is a `Finding`, whose text it shows.
    """


@contextmanager
def capture_warned_findings() -> Iterator[list[Finding]]:
    """Collect the findings that the block warns about; emit all other warnings again."""
    findings: list[Finding] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield findings
    for warning in caught:
        (content,) = getattr(warning.message, "args", ("",))[:1] or ("",)
        if isinstance(content, Finding):
            findings.append(content)
        else:
            warnings.warn_explicit(
                warning.message, warning.category, warning.filename, warning.lineno
            )
