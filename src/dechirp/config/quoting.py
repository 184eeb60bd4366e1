"""Quoting of text from files in messages."""


def quote_text(text: str) -> str:
    """Shorten a text to one printable line of at most 60 characters."""
    line = " ".join(text.split())
    line = line if line and line.isprintable() else repr(text)
    return line if len(line) <= 60 else f"{line[:57]}..."
