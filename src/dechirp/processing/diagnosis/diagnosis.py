"""Result of a diagnosis: mistakes that an array carries, and those that it cannot show."""

from typing import Self

from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass


@frozen_dataclass
class Diagnosis:
    """Mistakes that an array carries, and mistakes that cannot be told from it."""

    findings: tuple[Finding, ...] = ()
    """One warning for each mistake: evidence, significance and correction."""
    undetermined: tuple[Finding, ...] = ()
    """One note for each mistake that cannot be told, with the reason."""

    def __add__(self, other: Self) -> "Diagnosis":
        return Diagnosis(
            findings=self.findings + other.findings,
            undetermined=self.undetermined + other.undetermined,
        )


NOTHING_FOUND = Diagnosis()


def mistake_found(setting: str, *, value: str, expected: str, fix: str) -> Diagnosis:
    """Return the diagnosis of one mistake."""
    finding = Finding(level="warning", setting=setting, value=value, expected=expected, fix=fix)
    return Diagnosis(findings=(finding,))


def cannot_be_told(setting: str, *, value: str, expected: str, fix: str) -> Diagnosis:
    """Return the diagnosis that one mistake cannot be told, with what is missing."""
    text = f"cannot be told: {value}"
    finding = Finding(level="note", setting=setting, value=text, expected=expected, fix=fix)
    return Diagnosis(undetermined=(finding,))
