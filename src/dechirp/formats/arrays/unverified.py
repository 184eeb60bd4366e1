"""What is said of recordings whose layout nobody could check."""

from dataclasses import replace

from dechirp.core.findings import Finding
from dechirp.formats.base import Contents


def unverified(contents: Contents, name: str, *more: Finding) -> Contents:
    """Contents of a data set, with a warning that its layout is only documented."""
    warning = Finding(
        level="warning",
        setting="format",
        got=f"{name}, read from its documentation, never checked on a real file",
        need="a look at the first map: range and velocity of something that is known",
        fix="If it looks wrong, name the axes yourself with one of the generic formats.",
    )
    return replace(contents, findings=(*contents.findings, warning, *more))
