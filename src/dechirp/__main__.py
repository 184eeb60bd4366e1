"""Run as `python -m dechirp`."""

from dechirp.cli.main import main

main()
