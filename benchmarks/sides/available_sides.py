"""Available sides: dechirp, plain code, other packages and GNU Octave."""

import importlib
import shutil
import subprocess
import sys
from pathlib import Path

from sides import environments
from sides.side_processes import Absent, Side, build_environment, python_side

OCTAVE = Path(__file__).with_name("octave.m")


def create_sides(
    peers: list[str], folder: Path, *, threads: int, patience_s: float
) -> tuple[list[Side], dict[str, str], dict[str, dict[str, str]]]:
    """Create the available sides; return reasons for absent ones, and all versions."""
    sides = [
        python_side(
            name, f"sides.{name}", sys.executable, threads=threads, patience_s=120.0, ours=True
        )
        for name in ("ours", "plain")
    ]
    absent: dict[str, str] = {}
    versions = {"ours": environments.installed_versions(sys.executable)}
    for name in peers:
        try:
            if name == "octave":
                sides.append(create_octave_side(threads, 6 * patience_s))
                versions[name] = {"octave": octave_version()}
                continue
            python = environments.prepare_interpreter(name, folder)
            module = f"sides.peers.{name}"
            sides.append(python_side(name, module, python, threads=threads, patience_s=patience_s))
            versions[name] = environments.installed_versions(
                python, environments.required_packages(name)
            )
        except Absent as error:
            absent[name] = str(error)
    return sides, absent, versions


def create_octave_side(threads: int, patience_s: float) -> Side:
    program = shutil.which("octave-cli")
    if program is None:
        raise Absent("octave-cli is not on the PATH")
    command = [program, "--quiet", "--no-init-file", str(OCTAVE)]
    return Side("octave", command, build_environment(threads), patience_s)


def octave_version() -> str:
    process = subprocess.run(
        ["octave-cli", "--version"], capture_output=True, text=True, check=False
    )
    return process.stdout.partition("\n")[0]


def can_do(side: Side, kind: str) -> bool:
    """Return whether a side implements a kind of job; Octave implements only `frame`."""
    if side.name == "octave":
        return kind == "frame"
    module = side.name if side.name in ("ours", "plain") else f"peers.{side.name}"
    return hasattr(importlib.import_module(f"sides.{module}"), kind)
