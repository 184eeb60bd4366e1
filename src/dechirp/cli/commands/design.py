"""`dechirp design`: a waveform from requirements, with every formula."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dechirp.cli.options import Json, Quiet
from dechirp.core.values import frozen_dataclass
from dechirp.radar.design.design import DEFAULT_RULE, TYPICAL_HARDWARE, TYPICAL_LIMITS, Rule
from dechirp.radar.design.requirements import Limits
from dechirp.radar.hardware import Hardware

if TYPE_CHECKING:
    from dechirp.core.errors import InvalidFile, Mistake
    from dechirp.radar.design.design import Design
    from dechirp.radar.design.requirements import Requirements


@frozen_dataclass
class DesignAssumptions:
    """Limits and hardware of a design, both changed by `--set`."""

    limits: Limits = TYPICAL_LIMITS
    hardware: Hardware = TYPICAL_HARDWARE


_Text = Annotated[str | None, Parameter(allow_leading_hyphen=True)]  # -3 m/s is wrong elsewhere
_REQUIREMENT_PREFIX = "requirements."


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
    rule: Rule = DEFAULT_RULE,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
    out: Path | None = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Find the waveform that meets requirements, with every formula.

    The exit status is 1 if a requirement cannot be met; the nearest design is shown then.

    Parameters
    ----------
    requirements
        File of requirements (YAML); options replace its values.
    max_range
        Largest unambiguous range, such as 200m.
    range_resolution
        Largest allowed width of a range bin, such as 1m.
    max_velocity
        Largest unambiguous velocity, such as "100 m/s".
    velocity_resolution
        Largest allowed width of a velocity bin; 128 chirps by default.
    carrier
        Frequency at the start of the ramp; 77 GHz by default.
    sampling
        complex or real; complex by default.
    band
        Band that must contain the whole ramp: "76-77 GHz" or "77-81 GHz".
    rcs
        Cross section of the target to detect at the largest range, such as 10dBsm; adds the link
        budget to the checks.
    detection_probability
        Probability of detecting that target in one frame; 0.9 by default.
    false_alarm_probability
        Probability of a false alarm in each cell under test; 1e-6 by default.
    rule
        round-trips: chirps of 5.5 round trips. constraints: the limits of timing, hardware and
        regulation.
    changes
        PATH=VALUE changes a limit, the hardware or a requirement, such as limits.idle=1us or
        hardware.transmit_power=20dBm; may be repeated. Limits apply to the rule constraints.
    out
        File for the radar (YAML), readable by `run --radar`.
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
    from dechirp.radar.design.design import design as design_radar

    requirements_read, assumptions = _read_requirements_limits_and_hardware(
        requirements, options, changes or []
    )
    if rule != "constraints" and any(c.lstrip().startswith("limits") for c in changes or []):
        raise _limits_without_constraints_rule_error(rule)
    result = design_radar(
        requirements_read, rule=rule, limits=assumptions.limits, hardware=assumptions.hardware
    )
    if out is not None:
        from dechirp.config.dumping import dump_yaml
        from dechirp.core.atomic_files import write_text_atomically

        write_text_atomically(out, dump_yaml(result.radar))
    if as_json:
        _print_design_json(result)
    elif not quiet:
        _print_design(result, out)
    return 0 if result.is_met else 1


def _limits_without_constraints_rule_error(rule: str) -> "InvalidFile":
    from dechirp.core.errors import InvalidFile, Mistake

    return InvalidFile(
        Mistake(
            setting="--set",
            value=f"a limit, together with the rule {rule}",
            expected="limits together with the rule constraints, the only one that uses them",
            fix="add --rule constraints",
        )
    )


def _read_requirements_limits_and_hardware(
    path: Path | None, options: dict[str, str | None], changes: list[str]
) -> tuple["Requirements", DesignAssumptions]:
    """Read the requirements and the assumptions; options replace the values of the file."""
    from dechirp.cli.errors import replace_settings_by_options
    from dechirp.config import loading
    from dechirp.core.errors import InvalidFile
    from dechirp.radar.design.requirements import Requirements

    overrides = [f"{name}={text}" for name, text in options.items() if text is not None]
    requirement_changes = [
        change for change in changes if change.lstrip().startswith(_REQUIREMENT_PREFIX)
    ]
    overrides += [
        change.lstrip().removeprefix(_REQUIREMENT_PREFIX) for change in requirement_changes
    ]
    mistakes: list[Mistake] = []
    try:
        if path is None:
            requirements = loading.parse_settings(
                "{}", Requirements, file="--set", overrides=overrides
            )
        else:
            requirements = loading.read_settings(path, Requirements, overrides=overrides)
    except InvalidFile as error:
        names = {name: f"--{name.replace('_', '-')}" for name in options}
        mistakes += replace_settings_by_options(error, names).mistakes
    try:
        other_changes = [change for change in changes if change not in requirement_changes]
        assumptions = loading.parse_settings(
            "{}", DesignAssumptions, file="--set", overrides=other_changes
        )
    except InvalidFile as error:
        mistakes += error.mistakes
    if mistakes:
        raise InvalidFile(*mistakes)
    return requirements, assumptions


def _print_design_json(design: "Design") -> None:
    from dechirp.config.dumping import to_json_data
    from dechirp.results.text_files import to_json_text

    frame = to_json_data(design.radar.frame)
    document = {
        "chirp": frame.pop("chirp"),
        "frame": frame,
        "derived": {
            quantity.name: {
                "value": quantity.value,
                "unit": quantity.unit,
                "formula": quantity.formula,
            }
            for quantity in design.derived
        },
        "findings": [to_json_data(finding) for finding in design.findings],
    }
    print(to_json_text(document), end="")


def _print_design(design: "Design", out: Path | None) -> None:
    from dechirp.cli.console import finding_paragraphs, new_table, open_stdout_console

    screen = open_stdout_console()
    numbers = new_table(
        "Design" if design.is_met else "Nearest design", text_columns=["", "value", "formula"]
    )
    for row in design.derived:
        formula = f"{row.formula}  ({row.symbols})" if row.symbols else row.formula
        numbers.add_row(row.name.replace("_", " "), row.value_with_unit, formula)
    screen.print(numbers)
    for paragraph in finding_paragraphs(design.findings):
        screen.print(paragraph)
    if out is not None:
        screen.print(f"Radar: {out}")
