"""A virtual environment for each other package, made once and kept in a folder."""

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

from sides.turns import Absent, say

PEERS = Path(__file__).parent / "peers"
_INSTALL_S = 900.0


def names() -> list[str]:
    """Every other package that there is a file for."""
    return sorted(file.stem for file in PEERS.glob("*.py") if file.stem != "__init__")


def interpreter(name: str, folder: Path) -> str:
    """Python of the environment of that package; `Absent` where it cannot be made."""
    peer = importlib.import_module(f"sides.peers.{name}")
    place = folder / name
    python, done = place / "bin" / "python", place / "installed.json"
    wanted = list(required(name))
    if done.exists() and json.loads(done.read_text()) == wanted:
        return str(python)
    say(f"making an environment for {', '.join(wanted)}")
    create(with_version(getattr(peer, "PYTHON", "")), place)
    install = [str(python), "-m", "pip", "install", "--quiet", *wanted]
    try:
        made = subprocess.run(
            install, capture_output=True, text=True, timeout=_INSTALL_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise Absent(f"pip took above {_INSTALL_S:g} s") from None
    if made.returncode:
        told = [line for line in made.stderr.splitlines() if line.startswith("ERROR")]
        raise Absent("pip: " + (told[-1].removeprefix("ERROR: ") if told else "failed"))
    done.write_text(json.dumps(wanted))
    return str(python)


def with_version(version: str) -> str:
    """An interpreter of that version that runs, any on the path; this one where none is asked."""
    if not version:
        return sys.executable
    for folder in os.environ.get("PATH", "").split(os.pathsep):
        python = Path(folder) / f"python{version}"
        if python.exists():
            tried = subprocess.run([python, "-c", "import venv"], capture_output=True, check=False)
            if not tried.returncode:
                return str(python)
    raise Absent(f"it needs Python {version}, and none on the path runs")


def create(python: str, place: Path) -> None:
    made = subprocess.run(
        [python, "-m", "venv", "--clear", str(place)], capture_output=True, text=True, check=False
    )
    if made.returncode:
        raise Absent("python -m venv: " + made.stderr.strip().rpartition("\n")[2])


TOLD = ("python", "dechirp", "numpy", "scipy", "numba", "finufft", "torch", "pyfftw")


def versions(python: str, requires: tuple[str, ...] = ("stonesoup",)) -> dict[str, str]:
    """Of Python, of what a side asked for, and of what it computes with."""
    asked = (
        "import importlib.metadata as m, json, platform;"
        "print(json.dumps({d.metadata['Name'].lower(): d.version for d in m.distributions()}"
        " | {'python': platform.python_version()}))"
    )
    told = subprocess.run([python, "-c", asked], capture_output=True, text=True, check=False)
    every = json.loads(told.stdout) if not told.returncode else {}
    names = [*TOLD, *(one.partition("=")[0].lower() for one in requires)]
    return {name: every[name] for name in dict.fromkeys(names) if name in every}


def required(name: str) -> tuple[str, ...]:
    """What pip installs for that package."""
    return tuple(importlib.import_module(f"sides.peers.{name}").REQUIRES)
