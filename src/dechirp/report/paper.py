"""The technical paper about a certificate, a self-contained page."""

import math
import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Template
from markupsafe import Markup, escape

from dechirp.core.units import SPEED_OF_LIGHT, from_decibels
from dechirp.core.words import fixed, power_of_ten, small
from dechirp.report.amounts import amount, compared, counted, shown, typographic
from dechirp.report.dates import dated
from dechirp.report.equations import typeset
from dechirp.report.numbering import numbered
from dechirp.report.plates import half_way_db, plates
from dechirp.report.references import REFERENCES
from dechirp.report.template import environment

_LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "\N{MINUS SIGN}0123456789")


def render(document: Mapping[str, Any]) -> str:
    """Return the HTML of the paper; one document always gives one page.

    Parameters
    ----------
    document : mapping
        What `experiment.verify.document` gives, and `version`. All numbers of the text come
        from it; its seed gives the frames of the figures.

    Returns
    -------
    str
        A page that asks for no other file.
    """
    claims = {claim["id"]: claim for claim in document["claims"]}
    n = document["numbers"]
    beyond = [claim for part in document["parts"] for claim in part["claims"]]
    failed = [claim["id"] for claim in (*document["claims"], *beyond) if not claim["passed"]]
    return _template().render(
        d=document,
        n=n,
        claim=claims,
        failed=failed,
        n_beyond=len(beyond),
        date=dated(document["date"]),
        derived=_derived(claims, n),
        most_sides=max(map(_sides, document["claims"])),
        half_way_db=half_way_db(document),
        plates=plates(document),
    )


@cache
def _template() -> Template:
    paper = environment().overlay()
    paper.filters = paper.filters | {
        "amount": lambda number, unit, digits=4: _unbroken(amount(number, unit, digits)),
        "counted": counted,
        "fixed": _fixed,
        "db": lambda level_db, decimals=2: _unbroken(f"{_fixed(level_db, decimals)} dB"),
        "power_of_ten": lambda exponent: _raised(power_of_ten(exponent)),
        "shown": shown,
        "small": lambda probability: _unbroken(small(probability)),
        "typographic": lambda text: _raised(typographic(text)),
    }
    text, parts = (
        files("dechirp.report").joinpath(name).read_text(encoding="utf-8")
        for name in ("paper.html", "paper_parts.html")
    )
    text = text.replace("\\parts", parts)
    return paper.from_string(numbered(typeset(text), REFERENCES), globals={"compared": compared})


def _fixed(number: float | None, decimals: int) -> str:
    return fixed(_number(number), decimals)


def _unbroken(text: str) -> Markup:
    return _raised(text.replace(" ", "\N{NO-BREAK SPACE}"))


def _raised(text: str) -> Markup:
    """Exponents as HTML: few fonts have all of the raised digits."""
    return Markup(
        re.sub(
            "[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+",
            lambda found: f"<sup>{found[0].translate(_LOWERED)}</sup>",
            str(escape(text)),
        )
    )


def _derived(claims: Mapping[str, Any], n: Mapping[str, Any]) -> dict[str, Any]:
    """What the text concludes from the numbers of the document; nan where one is missing."""
    limits = claims["snr_limit"]["checks"]
    measured_db, limits_db = (
        _number(limits[-1][name]) - _number(limits[0][name]) for name in ("measured", "limit")
    )
    rates = [_number(check["measured"]) for check in claims["false_alarm_rate"]["checks"]]
    return {
        "rule_db": n["report_needed_db"] - n["needed_db"],
        "theory_db": limits_db,
        "measured_db": measured_db,
        # Power of an echo falls with the fourth power of range.
        "range_factor": 10 ** (measured_db / 40),
        # exp(-T) as a power of ten.
        "report_exponent": -round(float(from_decibels(n["report_threshold_db"])) / math.log(10)),
        "lowest_rate": min(rates),
        "highest_rate": max(rates),
        "pairs_found": [_hits(check) for check in claims["two_targets_resolved"]["checks"]],
        "over_bound": {
            name: _over_limit(claims[f"{name}_rmse"]["checks"][0]) for name in ("range", "velocity")
        },
        "coupling_over_bound": n["coupling_m"] / n["range_bound_m"],
        "report_offset": float(from_decibels(n["report_offset_db"])),
        "light_time": abs(n["target_velocity_m_per_s"]) / SPEED_OF_LIGHT,
    }


def _hits(check: Mapping[str, Any]) -> int | None:
    found = _number(check["measured"]) * _number(check["trials"])
    return round(found) if math.isfinite(found) else None


def _over_limit(check: Mapping[str, Any]) -> float:
    return _number(check["measured"]) / _number(check["limit"])


def _number(given: float | None) -> float:
    return math.nan if given is None else float(given)


def _sides(claim: Mapping[str, Any]) -> int:
    """Ends of intervals that decide on a claim."""
    return sum(
        len(check["required"] or {}) for check in claim["checks"] if check["interval"] is not None
    )
