"""All fuzzers, one after the other: file readers, entry points and the studio.

    python fuzz/all.py                   60 s for each of about thirty kinds of input
    python fuzz/all.py --seconds 600

The file readers need atheris (`pip install --group fuzz`, Linux) and are skipped without it.
"""

import argparse
import importlib.util
import subprocess
import sys
from pathlib import Path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=int, default=60, help="time per kind of input")
    options = parser.parse_args()
    scripts = ["readers.py", "entries.py", "studio.py"]
    if importlib.util.find_spec("atheris") is None:
        print("readers: skipped, because atheris is not installed")
        scripts.remove("readers.py")
    folder, seconds = Path(__file__).parent, ["--seconds", str(options.seconds)]
    statuses = [
        subprocess.run([sys.executable, folder / script, *seconds], check=False).returncode
        for script in scripts
    ]
    raise SystemExit(max(statuses))


if __name__ == "__main__":
    main()
