"""Command line: one file per command in `commands`, and the code that commands share."""
