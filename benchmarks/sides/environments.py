"""Virtual environments of the other packages, created once and reused."""

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

from sides.side_processes import Absent, print_progress

PEERS = Path(__file__).parent / "peers"
_INSTALL_S = 900.0


def peer_names() -> list[str]:
    """List the packages in `peers`."""
    return sorted(file.stem for file in PEERS.glob("*.py") if file.stem != "__init__")


def prepare_interpreter(name: str, folder: Path) -> str:
    """Return the interpreter of a package; raise `Absent` if its environment cannot be created."""
    peer = importlib.import_module(f"sides.peers.{name}")
    environment = folder / name
    python, marker = environment / "bin" / "python", environment / "installed.json"
    requirements = list(required_packages(name))
    if marker.exists() and json.loads(marker.read_text()) == requirements:
        return str(python)
    print_progress(f"creating an environment for {', '.join(requirements)}")
    create_environment(find_interpreter(getattr(peer, "PYTHON", "")), environment)
    install = [str(python), "-m", "pip", "install", "--quiet", *requirements]
    try:
        process = subprocess.run(
            install, capture_output=True, text=True, timeout=_INSTALL_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise Absent(f"pip took more than {_INSTALL_S:g} s") from None
    if process.returncode:
        errors = [line for line in process.stderr.splitlines() if line.startswith("ERROR")]
        raise Absent("pip: " + (errors[-1].removeprefix("ERROR: ") if errors else "failed"))
    marker.write_text(json.dumps(requirements))
    return str(python)


def find_interpreter(version: str) -> str:
    """Find a working interpreter of a version on the path; default: the current one."""
    if not version:
        return sys.executable
    for folder in os.environ.get("PATH", "").split(os.pathsep):
        python = Path(folder) / f"python{version}"
        if python.exists():
            process = subprocess.run(
                [python, "-c", "import venv"], capture_output=True, check=False
            )
            if not process.returncode:
                return str(python)
    raise Absent(f"requires Python {version}, which is not on the PATH or does not run")


def create_environment(python: str, folder: Path) -> None:
    process = subprocess.run(
        [python, "-m", "venv", "--clear", str(folder)], capture_output=True, text=True, check=False
    )
    if process.returncode:
        raise Absent("python -m venv: " + process.stderr.strip().rpartition("\n")[2])


REPORTED_PACKAGES = ("python", "dechirp", "numpy", "scipy", "numba", "finufft", "torch", "pyfftw")


def installed_versions(python: str, requires: tuple[str, ...] = ("stonesoup",)) -> dict[str, str]:
    """Return the versions of Python, of the requirements and of the numerical packages."""
    script = (
        "import importlib.metadata as m, json, platform;"
        "print(json.dumps({d.metadata['Name'].lower(): d.version for d in m.distributions()}"
        " | {'python': platform.python_version()}))"
    )
    process = subprocess.run([python, "-c", script], capture_output=True, text=True, check=False)
    all_versions = json.loads(process.stdout) if not process.returncode else {}
    names = [
        *REPORTED_PACKAGES,
        *(requirement.partition("=")[0].lower() for requirement in requires),
    ]
    return {name: all_versions[name] for name in dict.fromkeys(names) if name in all_versions}


def required_packages(name: str) -> tuple[str, ...]:
    """Return the requirements that pip installs for a package."""
    return tuple(importlib.import_module(f"sides.peers.{name}").REQUIRES)
