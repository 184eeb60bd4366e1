"""Tables of benchmark results as plain text and Markdown."""

from statistics import median, quantiles
from typing import Any

Row = dict[str, Any]


def build_row(job: str, side: str, ours: list[float], theirs: list[float], n_items: int) -> Row:
    """Times of one side of a job, and the ratio of ours to it turn by turn."""
    ratios = [a / b for a, b in zip(ours, theirs, strict=False)]
    low, _, high = quantiles(ratios, n=4) if len(ratios) > 3 else (min(ratios), 0, max(ratios))
    return {
        "job": job,
        "side": side,
        "ms": 1e3 * median(theirs) / n_items,
        "ratio": median(ratios),
        "ratio_low": low,
        "ratio_high": high,
        "turns": len(theirs),
    }


def format_cells(row: Row) -> list[str]:
    if "absent" in row:
        return [row["job"], row["side"], "-", "-", row["absent"]]
    spread = "" if row["side"] == "ours" else f"{row['ratio_low']:.3g} to {row['ratio_high']:.3g}"
    ratio = "1" if row["side"] == "ours" else f"{row['ratio']:.3g} ({spread})"
    right = ", ".join(
        f"{name} {value:.3g}" + format_spread(row["accuracy"], name)
        for name, value in row["accuracy"].items()
        if not name.endswith("_std")
    )
    return [row["job"], row["side"], f"{row['ms']:.3g}", ratio, right]


def format_spread(accuracy: dict[str, float], name: str) -> str:
    std = accuracy.get(f"{name}_std")
    return "" if std is None else f" +- {std:.2g}"


HEAD = ["job", "side", "ms", "ours / it (quartiles)", "accuracy"]


def plain_text(rows: list[Row]) -> str:
    """Columns side by side; a job's name stands once."""
    table = [HEAD, *(format_cells(row) for row in rows)]
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


def markdown(result: dict[str, Any]) -> str:
    """The table, the machine, and what is slower with what stops it."""
    lines = ["| " + " | ".join(HEAD) + " |", "|---|---|---|---|---|"]
    lines += ["| " + " | ".join(format_cells(version)) + " |" for version in result["rows"]]
    lines += ["", *(f"- {line}" for line in result["slower"]), ""]
    lines += machine_lines(result["machine"])
    for side, side_versions in result["versions"].items():
        lines.append(
            f"- {side}: "
            + ", ".join(f"{name} {version}" for name, version in side_versions.items())
        )
    return "\n".join([*lines, ""])
