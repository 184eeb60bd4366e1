"""Text of a file as messages quote it."""


def shown(text: str) -> str:
    """One line, nothing unprintable, not too long."""
    line = " ".join(text.split())
    line = line if line and line.isprintable() else repr(text)
    return line if len(line) <= 60 else f"{line[:57]}..."
