"""Waveform design: from requirements to the radar that meets them, or comes nearest."""

from collections.abc import Iterable
from functools import partial
from typing import Any, Literal

from dechirp.core.argument_types import check_argument_types
from dechirp.core.display import Displayable, Table
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, findings_display_table
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.design import by_constraints, by_round_trips
from dechirp.radar.design.derived import DerivedValue, derive_radar_values
from dechirp.radar.design.detection_range import detection_range_budget_and_findings
from dechirp.radar.design.relaxation import relax_requirements
from dechirp.radar.design.requirements import Limits, Requirements
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar

TYPICAL_HARDWARE = Hardware(
    transmit_power_w=10**-1.8, antenna_gain=10.0, noise_factor=10**1.2, loss=10**0.1
)
"""12 dBm, 10 dBi, noise figure 12 dB, 1 dB of loss: a single-chip radar at 77 GHz."""

TYPICAL_LIMITS = Limits()

EXAMPLE_REQUIREMENTS = Requirements(
    max_range_m=200.0, range_resolution_m=1.0, max_velocity_m_per_s=100.0
)
"""Requirements of the reference radar, an automotive long-range radar."""

Rule = Literal["round-trips", "constraints"]
DEFAULT_RULE: Rule = "round-trips"
"""Rule of the reference radar; it needs no limits of parts, see `design`."""


@frozen_dataclass
class Design(Displayable):
    """A designed radar, its derived values, and the requirements that it cannot meet."""

    radar: Radar
    derived: tuple[DerivedValue, ...]
    findings: tuple[Finding, ...]

    @property
    def is_met(self) -> bool:
        """True if every requirement is met and every limit is kept."""
        return not any(finding.level == "error" for finding in self.findings)

    def _display_line(self) -> str:
        return f"{'' if self.is_met else 'nearest, not all is met: '}{self.radar._display_line()}"

    def _display_tables(self) -> Iterable[Table]:
        yield findings_display_table(self.findings)
        rows = [
            (item.name.replace("_", " "), item.value_with_unit, item.formula)
            for item in self.derived
        ]
        yield Table("What follows", rows)


@check_argument_types
def design(
    requirements: Requirements | None = None,
    *,
    rule: Rule = DEFAULT_RULE,
    speed_of_light_m_per_s: float = SPEED_OF_LIGHT,
    limits: Limits = TYPICAL_LIMITS,
    hardware: Hardware = TYPICAL_HARDWARE,
    **fields: Any,
) -> Design:
    """Design a radar for requirements by a rule.

    Requirements that cannot be met are no error: the nearest radar is returned, with findings
    that name the relaxed requirement, its new value and the limit that caused it.

    Parameters
    ----------
    requirements : Requirements
        Alternatively its fields as keywords, such as `max_range_m=200`.
    rule : "round-trips" or "constraints"
        A chirp of 5.5 round trips sampled at twice its bandwidth, or the gentlest chirp
        that the timeline and `limits` allow.
    speed_of_light_m_per_s : float
        3e8 gives the numbers of textbooks that round it. Only the design uses it.
    limits : Limits
        Limits of parts, regulator and memory; used only by the rule "constraints".
    hardware : Hardware
        Hardware of the returned radar.

    Raises
    ------
    InvalidSetting
        For requirements that are invalid, given twice or missing; for limits that no radar can
        keep.
    """
    requested = _requirements_from_value_or_fields(requirements, fields)
    _check_rule_and_speed_of_light(rule, speed_of_light_m_per_s)
    c = speed_of_light_m_per_s
    if rule == "round-trips":
        relaxed, findings = relax_requirements(
            requested, partial(by_round_trips.find_broken_limits, speed_of_light_m_per_s=c)
        )
        frame = by_round_trips.design_frame(relaxed, speed_of_light_m_per_s=c)
        rule_values = by_round_trips.values_chosen_by_rule(relaxed, frame, speed_of_light_m_per_s=c)
        radar = Radar(frame=frame, hardware=hardware)
    else:
        find_broken_limits = partial(
            by_constraints.find_broken_limits, limits=limits, speed_of_light_m_per_s=c
        )
        relaxed, findings = relax_requirements(requested, find_broken_limits)
        constrained_frame = by_constraints.design_frame(
            relaxed, limits=limits, speed_of_light_m_per_s=c
        )
        assert constrained_frame is not None  # relaxed requirements leave time to sample
        rule_values = by_constraints.values_chosen_by_rule(
            relaxed, constrained_frame, limits=limits, speed_of_light_m_per_s=c
        )
        radar = Radar(frame=constrained_frame, hardware=hardware)
        findings += by_constraints.eirp_findings(radar, limits)
    budget, budget_findings = detection_range_budget_and_findings(radar, relaxed)
    return Design(
        radar=radar,
        derived=(
            *rule_values,
            *derive_radar_values(radar, relaxed, speed_of_light_m_per_s=c),
            *budget,
        ),
        findings=findings + budget_findings,
    )


def _requirements_from_value_or_fields(
    requirements: Requirements | None, fields: dict[str, Any]
) -> Requirements:
    if (requirements is None) == (not fields):
        raise InvalidSetting(
            "requirements",
            value="cannot be combined with keywords" if fields else "missing",
            expected="a Requirements value, or its fields as keywords",
            fix="for example design(max_range_m=200, range_resolution_m=1,"
            " max_velocity_m_per_s=100)",
        )
    return Requirements(**fields) if requirements is None else requirements


def _check_rule_and_speed_of_light(rule: str, speed_of_light_m_per_s: float) -> None:
    if rule not in ("round-trips", "constraints"):
        raise InvalidSetting(
            "rule", value=rule, expected="round-trips or constraints", fix="choose one"
        )
    if not abs(speed_of_light_m_per_s / SPEED_OF_LIGHT - 1) < 0.01:
        raise InvalidSetting(
            "speed_of_light_m_per_s",
            value=speed_of_light_m_per_s,
            expected=f"{SPEED_OF_LIGHT:.0f} m/s, or rounded, such as 3e8",
            fix="leave it out",
        )
