r"""Technical paper of a certificate, a self-contained HTML page.

The template cites and cross-references with LaTeX commands, which `resolve_labels_and_citations`
replaces:

    \label{figure:map}           number of a figure or table: Figure 7
    \ref{figure:map}             the same text, with a link
    \cite{stove,winkler}         [1, 4], numbered in the order of citation
    \bibliography                list of the cited references
"""

import math
import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Template
from markupsafe import Markup, escape

from dechirp.certificate.paper_figures import draw_paper_figures, midpoint_of_snr_limits_db
from dechirp.core.text import format_fixed, format_power_of_ten, format_probability
from dechirp.core.units import SPEED_OF_LIGHT, from_decibels
from dechirp.report.check_values import (
    apply_typography,
    format_amount,
    format_check_row,
    format_count,
    format_pair,
)
from dechirp.report.equations import typeset_equations
from dechirp.report.template import format_date_and_time, template_environment

REFERENCES = {
    "stove": "A. G. Stove, “Linear FMCW radar techniques,” IEE Proceedings F, vol. 139, no. 5,"
    " pp. 343-350, 1992.",
    "griffiths": "H. D. Griffiths, “New ideas in FM radar,” Electronics & Communication"
    " Engineering Journal, vol. 2, no. 5, pp. 185-194, 1990.",
    "rohling-meinecke": "H. Rohling and M.-M. Meinecke, “Waveform design principles for"
    " automotive radar systems,” in Proc. CIE International Conference on Radar, Beijing,"
    " pp. 1-4, 2001.",
    "winkler": "V. Winkler, “Range Doppler detection for automotive FMCW radars,” in Proc."
    " European Radar Conference, Munich, pp. 166-169, 2007.",
    "marcum": "J. I. Marcum, “A statistical theory of target detection by pulsed radar,” IRE"
    " Transactions on Information Theory, vol. 6, no. 2, pp. 59-267, 1960.",
    "swerling": "P. Swerling, “Probability of detection for fluctuating targets,” IRE"
    " Transactions on Information Theory, vol. 6, no. 2, pp. 269-308, 1960.",
    "finn-johnson": "H. M. Finn and R. S. Johnson, “Adaptive detection mode with threshold"
    " control as a function of spatially sampled clutter-level estimates,” RCA Review, vol. 29,"
    " no. 3, pp. 414-464, 1968.",
    "gandhi-kassam": "P. P. Gandhi and S. A. Kassam, “Analysis of CFAR processors in"
    " nonhomogeneous background,” IEEE Transactions on Aerospace and Electronic Systems,"
    " vol. 24, no. 4, pp. 427-445, 1988.",
    "rohling": "H. Rohling, “Radar CFAR thresholding in clutter and multiple target"
    " situations,” IEEE Transactions on Aerospace and Electronic Systems, vol. 19, no. 4,"
    " pp. 608-621, 1983.",
    "rife-boorstyn": "D. C. Rife and R. R. Boorstyn, “Single-tone parameter estimation from"
    " discrete-time observations,” IEEE Transactions on Information Theory, vol. 20, no. 5,"
    " pp. 591-598, 1974.",
    "kay": "S. M. Kay, Fundamentals of Statistical Signal Processing, vol. I: Estimation"
    " Theory. Prentice Hall, 1993.",
    "harris": "F. J. Harris, “On the use of windows for harmonic analysis with the discrete"
    " Fourier transform,” Proceedings of the IEEE, vol. 66, no. 1, pp. 51-83, 1978.",
    "clopper-pearson": "C. J. Clopper and E. S. Pearson, “The use of confidence or fiducial"
    " limits illustrated in the case of the binomial,” Biometrika, vol. 26, no. 4, pp. 404-413,"
    " 1934.",
    "richards": "M. A. Richards, Fundamentals of Radar Signal Processing, 2nd ed. McGraw-Hill,"
    " 2014.",
    "li-stoica": "J. Li and P. Stoica, “Efficient mixed-spectrum estimation with applications"
    " to target feature extraction,” IEEE Transactions on Signal Processing, vol. 44, no. 2,"
    " pp. 281-295, 1996.",
}
"""References of the paper by key, as in `docs/references.bib`; the page sets the dashes of page
ranges."""

_LABEL = re.compile(r"\\label\{(\w+):(\w+)\}")
_REFERENCE = re.compile(r"\\ref\{(\w+):(\w+)\}")
_CITE = re.compile(r"\\cite\{([\w,-]+)\}")
_BIBLIOGRAPHY = r"\bibliography"
_LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "\N{MINUS SIGN}0123456789")


def render_paper(document: Mapping[str, Any]) -> str:
    """Return the HTML of the paper; equal documents give equal pages.

    Parameters
    ----------
    document : mapping
        Result of `certificate.document.certificate_as_json_data`, and `version`. It provides all
        numbers of the text; the frames of the figures are simulated with its seed.

    Returns
    -------
    str
        Self-contained HTML page.
    """
    claims = {claim["id"]: claim for claim in document["claims"]}
    n = document["numbers"]
    beyond = [claim for part in document["parts"] for claim in part["claims"]]
    failed = [claim["id"] for claim in (*document["claims"], *beyond) if not claim["passed"]]
    return _paper_template().render(
        d=document,
        n=n,
        claim=claims,
        failed=failed,
        n_beyond=len(beyond),
        date=format_date_and_time(document["date"]),
        derived=_derived_numbers_of_paper(claims, n),
        most_sides=max(map(_count_required_interval_ends, document["claims"])),
        midpoint_snr_db=midpoint_of_snr_limits_db(document),
        figures=draw_paper_figures(document),
    )


@cache
def _paper_template() -> Template:
    paper = template_environment("dechirp.certificate").overlay()
    paper.filters = paper.filters | {
        "amount": lambda number, unit, digits=4: _html_with_nonbreaking_spaces(
            format_amount(number, unit, digits)
        ),
        "count": format_count,
        "fixed": _format_fixed,
        "db": lambda level_db, decimals=2: _html_with_nonbreaking_spaces(
            f"{_format_fixed(level_db, decimals)} dB"
        ),
        "power_of_ten": lambda exponent: _superscripts_as_html(format_power_of_ten(exponent)),
        "check": format_check_row,
        "small": lambda probability: _html_with_nonbreaking_spaces(format_probability(probability)),
        "typography": lambda text: _superscripts_as_html(apply_typography(text)),
    }
    text, parts = (
        files("dechirp.certificate").joinpath(name).read_text(encoding="utf-8")
        for name in ("paper.html", "paper_parts.html")
    )
    text = text.replace("\\parts", parts)
    return paper.from_string(
        resolve_labels_and_citations(typeset_equations(text), REFERENCES),
        globals={"format_pair": format_pair},
    )


def _format_fixed(number: float | None, decimals: int) -> str:
    return format_fixed(_number_or_nan(number), decimals)


def _html_with_nonbreaking_spaces(text: str) -> Markup:
    return _superscripts_as_html(text.replace(" ", "\N{NO-BREAK SPACE}"))


def _superscripts_as_html(text: str) -> Markup:
    """Write superscripts as HTML, because few fonts contain all superscript digits."""
    return Markup(
        re.sub(
            "[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+",
            lambda match: f"<sup>{match[0].translate(_LOWERED)}</sup>",
            str(escape(text)),
        )
    )


def _derived_numbers_of_paper(
    claims: Mapping[str, Any], numbers: Mapping[str, Any]
) -> dict[str, Any]:
    """Return numbers of the text that follow from those of the document, NaN if one is missing."""
    limits = claims["snr_limit"]["checks"]
    measured_db, limits_db = (
        _number_or_nan(limits[-1][name]) - _number_or_nan(limits[0][name])
        for name in ("measured", "limit")
    )
    rates = [_number_or_nan(check["measured"]) for check in claims["false_alarm_rate"]["checks"]]
    return {
        "rule_db": numbers["report_needed_db"] - numbers["needed_db"],
        "theory_db": limits_db,
        "measured_db": measured_db,
        # Power of an echo falls with the fourth power of range.
        "range_factor": 10 ** (measured_db / 40),
        # exp(-T) as a power of ten.
        "report_exponent": -round(
            float(from_decibels(numbers["report_threshold_db"])) / math.log(10)
        ),
        "lowest_rate": min(rates),
        "highest_rate": max(rates),
        "pairs_found": [_hit_count(check) for check in claims["two_targets_resolved"]["checks"]],
        "over_bound": {
            name: _ratio_to_theory(claims[f"{name}_rmse"]["checks"][0])
            for name in ("range", "velocity")
        },
        "coupling_over_bound": numbers["coupling_m"] / numbers["range_bound_m"],
        "report_offset": float(from_decibels(numbers["report_offset_db"])),
        "light_time": abs(numbers["target_velocity_m_per_s"]) / SPEED_OF_LIGHT,
    }


def _hit_count(check: Mapping[str, Any]) -> int | None:
    n_hits = _number_or_nan(check["measured"]) * _number_or_nan(check["trials"])
    return round(n_hits) if math.isfinite(n_hits) else None


def _ratio_to_theory(check: Mapping[str, Any]) -> float:
    return _number_or_nan(check["measured"]) / _number_or_nan(check["limit"])


def _number_or_nan(number: float | None) -> float:
    return math.nan if number is None else float(number)


def _count_required_interval_ends(claim: Mapping[str, Any]) -> int:
    """Count the interval ends with a requirement in a claim."""
    return sum(
        len(check["required"] or {}) for check in claim["checks"] if check["interval"] is not None
    )


def resolve_labels_and_citations(text: str, references: Mapping[str, str]) -> str:
    """Replace labels, cross-references, citations and the bibliography of a page.

    Raises
    ------
    KeyError
        If a label or a cited reference does not exist.
    """
    labels: dict[tuple[str, str], str] = {}
    counts: dict[str, int] = {}
    for kind, name in _LABEL.findall(text):
        counts[kind] = counts.get(kind, 0) + 1
        labels[kind, name] = f"{kind.capitalize()} {counts[kind]}"
    cited = list(dict.fromkeys(key for keys in _CITE.findall(text) for key in str(keys).split(",")))

    def label(match: re.Match[str]) -> str:
        return f'<b id="{match[1]}-{match[2]}">{labels[match[1], match[2]]}</b>'

    def link(match: re.Match[str]) -> str:
        return f'<a href="#{match[1]}-{match[2]}">{labels[match[1], match[2]]}</a>'

    def cite(match: re.Match[str]) -> str:
        keys = sorted(match[1].split(","), key=cited.index)
        links = (f'<a href="#ref-{key}">{cited.index(key) + 1}</a>' for key in keys)
        return f"[{', '.join(links)}]"

    items = (
        f'<li id="ref-{key}">'
        + re.sub(r"(?<=\d)-(?=\d)", "\N{EN DASH}", str(escape(references[key])))
        + "</li>"
        for key in cited
    )
    text = _CITE.sub(cite, _REFERENCE.sub(link, _LABEL.sub(label, text)))
    return text.replace(_BIBLIOGRAPHY, f'<ol class="references">{"".join(items)}</ol>')
