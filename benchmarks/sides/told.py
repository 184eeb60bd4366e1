"""Tables of what was measured: on the screen, and as Markdown."""

from statistics import median, quantiles
from typing import Any

Row = dict[str, Any]


def row(job: str, side: str, ours: list[float], theirs: list[float], each: int) -> Row:
    """Times of one side of a job, and the ratio of ours to it turn by turn."""
    ratios = [a / b for a, b in zip(ours, theirs, strict=False)]
    low, _, high = quantiles(ratios, n=4) if len(ratios) > 3 else (min(ratios), 0, max(ratios))
    return {
        "job": job,
        "side": side,
        "ms": 1e3 * median(theirs) / each,
        "ratio": median(ratios),
        "ratio_low": low,
        "ratio_high": high,
        "turns": len(theirs),
    }


def cells(one: Row) -> list[str]:
    if "absent" in one:
        return [one["job"], one["side"], "-", "-", one["absent"]]
    spread = "" if one["side"] == "ours" else f"{one['ratio_low']:.3g} to {one['ratio_high']:.3g}"
    ratio = "1" if one["side"] == "ours" else f"{one['ratio']:.3g} ({spread})"
    right = ", ".join(
        f"{name} {value:.3g}" + spread_of(one["accuracy"], name)
        for name, value in one["accuracy"].items()
        if not name.endswith("_std")
    )
    return [one["job"], one["side"], f"{one['ms']:.3g}", ratio, right]


def spread_of(accuracy: dict[str, float], name: str) -> str:
    std = accuracy.get(f"{name}_std")
    return "" if std is None else f" +- {std:.2g}"


HEAD = ["job", "side", "ms", "ours / it (quartiles)", "how right"]


def plain_text(rows: list[Row]) -> str:
    """Columns side by side; a job's name stands once."""
    table = [HEAD, *(cells(one) for one in rows)]
    widths = [max(len(line[k]) for line in table if k < 4) for k in range(4)]
    lines, last = [], ""
    for line in table:
        name = "" if line[0] == last else line[0]
        last = line[0]
        padded = [
            f"{word:<{width}}" for word, width in zip([name, *line[1:4]], widths, strict=True)
        ]
        lines.append("  ".join([*padded, line[4]]).rstrip())
    return "\n".join(lines)


def machine_lines(machine: dict[str, Any]) -> list[str]:
    rates = ", ".join(
        f"{name.removesuffix('_per_s').replace('_', ' ')} {machine[name] / 1e9:.3g} G/s"
        for name in machine
        if name.endswith("_per_s")
    )
    caches = ", ".join(f"{level} {size}" for level, size in machine["caches"].items())
    return [
        f"{machine['cpu']}, {machine['cores']} cores, {caches}, {machine['system']}",
        f"one core, measured in this run: {rates}; load when begun {machine['load']:.2f}",
    ]


def markdown(found: dict[str, Any]) -> str:
    """The table, the machine, and what is slower with what stops it."""
    lines = ["| " + " | ".join(HEAD) + " |", "|---|---|---|---|---|"]
    lines += ["| " + " | ".join(cells(one)) + " |" for one in found["rows"]]
    lines += ["", *(f"- {line}" for line in found["slower"]), ""]
    lines += machine_lines(found["machine"])
    for side, told in found["versions"].items():
        lines.append(f"- {side}: " + ", ".join(f"{name} {one}" for name, one in told.items()))
    return "\n".join([*lines, ""])
