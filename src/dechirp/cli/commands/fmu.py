"""`dechirp fmu`: a radar as a functional mock-up unit for co-simulation."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from dechirp.cli.options import Quiet


def fmu(
    settings: Path,
    /,
    *,
    out: Path = Path("radar.fmu"),
    mount: str | None = None,
    kind: Literal["samples", "statistical"] = "samples",
    seed: int | None = None,
    quiet: Quiet = False,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
) -> int:
    """Pack a radar as an FMU: OSI SensorView in, SensorData out (FMI 2, OSMP).

    The Python that runs it needs dechirp of this version, with the extras io and track.

    Parameters
    ----------
    settings
        Scenario (YAML), whose radar, impairments, chain and tracker are packed.
    out
        File to write; an existing one is replaced.
    mount
        Place on the host vehicle, such as front or rear-left; by default the mounting position of
        the view, and without one the front.
    kind
        Simulate samples, or draw detections from their distribution, which is faster.
    seed
        Seed of the noise; replaces the seed of the scenario.
    changes
        PATH=VALUE changes a setting, such as radar.frame.n_chirps=64; may be repeated.
    """
    from dechirp.cli.errors import replace_settings_by_options
    from dechirp.cli.fmu_file import REQUIREMENT, write_fmu
    from dechirp.core.errors import DechirpError
    from dechirp.experiments.scenario import load

    scenario = load(settings, changes or [])
    try:
        write_fmu(scenario, out, mount=mount, kind=kind, seed=seed)
    except DechirpError as error:
        options = {"path": "--out", "traffic.mount": "--mount", "SensorModel.seed": "--seed"}
        raise replace_settings_by_options(error, options) from None
    if not quiet:
        print(f"{out}: FMI 2, OSMP; the Python that runs it needs {REQUIREMENT}")
    return 0
