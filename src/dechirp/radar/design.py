"""From requirements to the radar that meets them, or comes nearest."""

from collections.abc import Iterable
from functools import partial
from typing import Any, Literal

from dechirp.core.displayed import Displayed, Table
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, findings
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.radar import constraints, round_trips
from dechirp.radar.derived import Derived, what_follows
from dechirp.radar.hardware import Hardware
from dechirp.radar.nearest import nearest
from dechirp.radar.radar import Radar
from dechirp.radar.reach import reach
from dechirp.radar.requirements import Limits, Requirements

TYPICAL_HARDWARE = Hardware(
    transmit_power_w=10**-1.8, antenna_gain=10.0, noise_factor=10**1.2, loss=10**0.1
)
"""12 dBm, 10 dBi, noise figure 12 dB, 1 dB of loss: a single-chip radar at 77 GHz."""

TYPICAL_LIMITS = Limits()


@value
class Design(Displayed):
    """A radar, every number it follows from, and what it cannot do."""

    radar: Radar
    derived: tuple[Derived, ...]
    findings: tuple[Finding, ...]

    @property
    def met(self) -> bool:
        """Whether every requirement is met and every limit is kept."""
        return not any(finding.level == "error" for finding in self.findings)

    def _line(self) -> str:
        return f"{'' if self.met else 'nearest, not all is met: '}{self.radar._line()}"

    def _tables(self) -> Iterable[Table]:
        yield findings(self.findings)
        rows = [(one.name.replace("_", " "), one.text, one.formula) for one in self.derived]
        yield Table("What follows", rows)


def design(
    requirements: Requirements | None = None,
    *,
    rule: Literal["round-trips", "constraints"] = "round-trips",
    speed_of_light_m_per_s: float = SPEED_OF_LIGHT,
    limits: Limits = TYPICAL_LIMITS,
    hardware: Hardware = TYPICAL_HARDWARE,
    **fields: Any,
) -> Design:
    """Radar for requirements, by a rule.

    Requirements that cannot be met are no error: the radar that comes nearest is returned
    with findings that say which requirement had to give, to what, and because of what.

    Parameters
    ----------
    requirements : Requirements
        Or its fields as keywords, such as `max_range_m=200`.
    rule : "round-trips" or "constraints"
        A chirp of 5.5 round trips sampled at twice its bandwidth, or the gentlest chirp
        that the timeline and `limits` allow.
    speed_of_light_m_per_s : float
        3e8 gives the numbers of textbooks that round it. Only the design uses it.
    limits : Limits
        What parts, regulator and memory allow; only read by the rule "constraints".
    hardware : Hardware
        That of the radar returned.

    Raises
    ------
    InvalidSetting
        For requirements that make no sense, given twice or not at all; for limits that no
        radar keeps.
    """
    asked = _one_of(requirements, fields)
    _check(rule, speed_of_light_m_per_s)
    c = speed_of_light_m_per_s
    if rule == "round-trips":
        met, findings = nearest(asked, partial(round_trips.breaks, speed_of_light_m_per_s=c))
        frame = round_trips.frame(met, speed_of_light_m_per_s=c)
        chosen = round_trips.derived(met, frame, speed_of_light_m_per_s=c)
        radar = Radar(frame=frame, hardware=hardware)
    else:
        within = partial(constraints.breaks, limits=limits, speed_of_light_m_per_s=c)
        met, findings = nearest(asked, within)
        kept = constraints.frame(met, limits=limits, speed_of_light_m_per_s=c)
        assert kept is not None  # requirements that break nothing leave time to sample
        chosen = constraints.derived(met, kept, limits=limits, speed_of_light_m_per_s=c)
        radar = Radar(frame=kept, hardware=hardware)
        findings += constraints.over_eirp(radar, limits)
    budget, too_weak = reach(radar, met)
    return Design(
        radar=radar,
        derived=(*chosen, *what_follows(radar, met, speed_of_light_m_per_s=c), *budget),
        findings=findings + too_weak,
    )


def _one_of(requirements: Requirements | None, fields: dict[str, Any]) -> Requirements:
    if (requirements is None) == (not fields):
        raise InvalidSetting(
            "requirements",
            got="given twice" if fields else "not given",
            need="a Requirements value or its fields as keywords, one of both",
            fix="For example design(max_range_m=200, range_resolution_m=1,"
            " max_velocity_m_per_s=100).",
        )
    return Requirements(**fields) if requirements is None else requirements


def _check(rule: str, speed_of_light_m_per_s: float) -> None:
    if rule not in ("round-trips", "constraints"):
        raise InvalidSetting("rule", got=rule, need="round-trips or constraints", fix="Choose one.")
    if not abs(speed_of_light_m_per_s / SPEED_OF_LIGHT - 1) < 0.01:
        raise InvalidSetting(
            "speed_of_light_m_per_s",
            got=speed_of_light_m_per_s,
            need=f"{SPEED_OF_LIGHT:.0f} m/s, or rounded, such as 3e8",
            fix="Leave it out.",
        )
