"""Dates in words: in English and in UTC, whatever language and time zone the process has."""

from datetime import UTC, datetime

# fmt: off
_MONTHS = (
    "January", "February", "March", "April", "May", "June",
    "July", "August", "September", "October", "November", "December",
)
# fmt: on


def dated(iso: str) -> str:
    """Day and minute of a date of ISO 8601; one without a time zone is in UTC."""
    at = datetime.fromisoformat(iso)
    at = at.replace(tzinfo=UTC) if at.tzinfo is None else at.astimezone(UTC)
    return f"{at.day} {_MONTHS[at.month - 1]} {at:%Y, %H:%M} UTC"
