"""Which sides there are: ours, plain, other packages in their environments, and GNU Octave."""

import importlib
import shutil
import subprocess
import sys
from pathlib import Path

from sides import environments
from sides.turns import Absent, Side, python_side, surroundings

OCTAVE = Path(__file__).with_name("octave.m")


def made(
    peers: list[str], folder: Path, *, threads: int, patience_s: float
) -> tuple[list[Side], dict[str, str], dict[str, dict[str, str]]]:
    """Sides that can be asked, why others cannot, and versions of what is in each."""
    here = [
        python_side(
            name, f"sides.{name}", sys.executable, threads=threads, patience_s=120.0, ours=True
        )
        for name in ("ours", "plain")
    ]
    absent: dict[str, str] = {}
    versions = {"ours": environments.versions(sys.executable)}
    for name in peers:
        try:
            if name == "octave":
                here.append(octave(threads, 6 * patience_s))
                versions[name] = {"octave": octave_version()}
                continue
            python = environments.interpreter(name, folder)
            module = f"sides.peers.{name}"
            here.append(python_side(name, module, python, threads=threads, patience_s=patience_s))
            versions[name] = environments.versions(python, environments.required(name))
        except Absent as why:
            absent[name] = str(why)
    return here, absent, versions


def octave(threads: int, patience_s: float) -> Side:
    program = shutil.which("octave-cli")
    if program is None:
        raise Absent("no octave-cli on the path")
    command = [program, "--quiet", "--no-init-file", str(OCTAVE)]
    return Side("octave", command, surroundings(threads), patience_s)


def octave_version() -> str:
    told = subprocess.run(["octave-cli", "--version"], capture_output=True, text=True, check=False)
    return told.stdout.partition("\n")[0]


def does(side: Side, kind: str) -> bool:
    """Whether a side has a function for jobs of that kind; Octave has the report's chain alone."""
    if side.name == "octave":
        return kind == "frame"
    module = side.name if side.name in ("ours", "plain") else f"peers.{side.name}"
    return hasattr(importlib.import_module(f"sides.{module}"), kind)
