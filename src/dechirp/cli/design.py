"""`dechirp design`: requirements in, a waveform with all its formulas out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from dechirp.cli.options import Json, Quiet

if TYPE_CHECKING:
    from dechirp.cli.assumed import Assumed
    from dechirp.core.errors import InvalidFile, Mistake
    from dechirp.radar.design import Design
    from dechirp.radar.requirements import Requirements

_Text = Annotated[str | None, Parameter(allow_leading_hyphen=True)]  # -3 m/s is wrong elsewhere
_OF_REQUIREMENTS = "requirements."


def design(
    requirements: Path | None = None,
    /,
    *,
    max_range: _Text = None,
    range_resolution: _Text = None,
    max_velocity: _Text = None,
    velocity_resolution: _Text = None,
    carrier: _Text = None,
    sampling: _Text = None,
    band: _Text = None,
    rcs: _Text = None,
    detection_probability: _Text = None,
    false_alarm_probability: _Text = None,
    rule: Literal["round-trips", "constraints"] = "round-trips",
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
    out: Path | None = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Find the waveform that meets requirements, with every formula.

    Ends with status 1 if a requirement cannot be met; the nearest radar is shown then.

    Parameters
    ----------
    requirements
        File of requirements (YAML); options replace what it says.
    max_range
        Farthest target that must not alias, as 200m.
    range_resolution
        Width of a range bin, at most, as 1m.
    max_velocity
        Fastest target that must not fold, as "100 m/s".
    velocity_resolution
        Width of a velocity bin, at most; without it, 128 chirps.
    carrier
        Frequency at the start of the ramp; 77 GHz without it.
    sampling
        complex or real; complex without it.
    band
        "76-77 GHz" or "77-81 GHz": where the whole ramp must stay.
    rcs
        Target to detect at the largest range, as 10dBsm; checks the link budget.
    detection_probability
        Of that target in one frame; 0.9 without it.
    false_alarm_probability
        For each cell tested; 1e-6 without it.
    rule
        Chirps of 5.5 round trips, or what timeline, parts and regulator allow.
    changes
        PATH=VALUE changes a limit, the hardware or a requirement, as limits.idle=1us or
        hardware.transmit_power=20dBm; may be repeated. Limits are of the rule constraints.
    out
        File for the radar (YAML), as `run --radar` reads it.
    """
    options = {
        "max_range": max_range,
        "range_resolution": range_resolution,
        "max_velocity": max_velocity,
        "velocity_resolution": velocity_resolution,
        "carrier": carrier,
        "sampling": sampling,
        "band": band,
        "rcs": rcs,
        "detection_probability": detection_probability,
        "false_alarm_probability": false_alarm_probability,
    }
    from dechirp.radar.design import design as design_radar

    asked, assumed = _asked(requirements, options, changes or [])
    if rule != "constraints" and any(c.lstrip().startswith("limits") for c in changes or []):
        raise _no_limits(rule)
    made = design_radar(asked, rule=rule, limits=assumed.limits, hardware=assumed.hardware)
    if out is not None:
        from dechirp.config.texts import dump
        from dechirp.store.whole import write_whole

        write_whole(out, dump(made.radar))
    if as_json:
        _print_json(made)
    elif not quiet:
        _show(made, out)
    return 0 if made.met else 1


def _no_limits(rule: str) -> "InvalidFile":
    from dechirp.core.errors import InvalidFile, Mistake

    return InvalidFile(
        Mistake(
            setting="--set",
            got=f"given for limits, with the rule {rule}",
            need="given for limits with the rule constraints, which alone keeps them",
            fix="Add --rule constraints.",
        )
    )


def _asked(
    path: Path | None, options: dict[str, str | None], changes: list[str]
) -> "tuple[Requirements, Assumed]":
    """Requirements of the file, with the options in the place of what it says, and the rest."""
    from dechirp.cli.assumed import Assumed
    from dechirp.cli.wrong import under_option
    from dechirp.config import files
    from dechirp.core.errors import InvalidFile
    from dechirp.radar.requirements import Requirements

    asked = [f"{name}={text}" for name, text in options.items() if text is not None]
    own = [change for change in changes if change.lstrip().startswith(_OF_REQUIREMENTS)]
    asked += [change.lstrip().removeprefix(_OF_REQUIREMENTS) for change in own]
    wrong: list[Mistake] = []
    try:
        if path is None:
            requirements = files.parse("{}", Requirements, file="--set", overrides=asked)
        else:
            requirements = files.read(path, Requirements, overrides=asked)
    except InvalidFile as error:
        names = {name: f"--{name.replace('_', '-')}" for name in options}
        wrong += under_option(error, names).mistakes
    try:
        rest = [change for change in changes if change not in own]
        assumed = files.parse("{}", Assumed, file="--set", overrides=rest)
    except InvalidFile as error:
        wrong += error.mistakes
    if wrong:
        raise InvalidFile(*wrong)
    return requirements, assumed


def _print_json(made: "Design") -> None:
    from dechirp.config.texts import plain
    from dechirp.store.tables import json_text

    frame = plain(made.radar.frame)
    document = {
        "chirp": frame.pop("chirp"),
        "frame": frame,
        "derived": {
            one.name: {"value": one.value, "unit": one.unit, "formula": one.formula}
            for one in made.derived
        },
        "findings": [plain(finding) for finding in made.findings],
    }
    print(json_text(document), end="")


def _show(made: "Design", out: Path | None) -> None:
    from dechirp.cli.show import console, findings, table

    screen = console()
    numbers = table("Design" if made.met else "Nearest design", left=["", "value", "formula"])
    for one in made.derived:
        formula = f"{one.formula}  ({one.uses})" if one.uses else one.formula
        numbers.add_row(one.name.replace("_", " "), one.text, formula)
    screen.print(numbers)
    for paragraph in findings(made.findings):
        screen.print(paragraph)
    if out is not None:
        screen.print(f"Radar: {out}", soft_wrap=True)
