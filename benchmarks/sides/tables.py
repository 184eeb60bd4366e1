"""Tables of benchmark results as plain text and Markdown."""

from statistics import median, quantiles
from typing import Any

Row = dict[str, Any]


def build_row(
    job: str, side: str, dechirp_s: list[float], side_s: list[float], n_items: int
) -> Row:
    """Build the table row of one side: its median time and the ratios of dechirp to it per turn."""
    ratios = [a / b for a, b in zip(dechirp_s, side_s, strict=False)]
    low, _, high = quantiles(ratios, n=4) if len(ratios) > 3 else (min(ratios), 0, max(ratios))
    return {
        "job": job,
        "side": side,
        "ms": 1e3 * median(side_s) / n_items,
        "ratio": median(ratios),
        "ratio_low": low,
        "ratio_high": high,
        "turns": len(side_s),
    }


def format_cells(row: Row) -> list[str]:
    if "absent" in row:
        return [row["job"], row["side"], "-", "-", row["absent"]]
    spread = "" if row["side"] == "ours" else f"{row['ratio_low']:.3g} to {row['ratio_high']:.3g}"
    ratio = "1" if row["side"] == "ours" else f"{row['ratio']:.3g} ({spread})"
    accuracy = ", ".join(
        f"{name} {value:.3g}" + format_spread(row["accuracy"], name)
        for name, value in row["accuracy"].items()
        if not name.endswith("_std")
    )
    return [row["job"], row["side"], f"{row['ms']:.3g}", ratio, accuracy]


def format_spread(accuracy: dict[str, float], name: str) -> str:
    std = accuracy.get(f"{name}_std")
    return "" if std is None else f" +- {std:.2g}"


COLUMN_HEADINGS = ["job", "side", "ms", "dechirp / side (quartiles)", "accuracy"]


def format_text(rows: list[Row]) -> str:
    """Format the rows in aligned columns; repeated job names are blank."""
    table = [COLUMN_HEADINGS, *(format_cells(row) for row in rows)]
    widths = [max(len(line[k]) for line in table if k < 4) for k in range(4)]
    lines, previous_job = [], ""
    for line in table:
        name = "" if line[0] == previous_job else line[0]
        previous_job = line[0]
        padded = [
            f"{cell:<{width}}" for cell, width in zip([name, *line[1:4]], widths, strict=True)
        ]
        lines.append("  ".join([*padded, line[4]]).rstrip())
    return "\n".join(lines)


def format_machine(machine: dict[str, Any]) -> list[str]:
    rates = ", ".join(
        f"{name.removesuffix('_per_s').replace('_', ' ')} {machine[name] / 1e9:.3g} G/s"
        for name in machine
        if name.endswith("_per_s")
    )
    caches = ", ".join(f"{level} {size}" for level, size in machine["caches"].items())
    return [
        f"{machine['cpu']}, {machine['cores']} cores, {caches}, {machine['system']}",
        f"rates of one core in this run: {rates}; load at the start {machine['load']:.2f}",
    ]


def format_markdown(result: dict[str, Any]) -> str:
    """Format the table, the slower jobs with their limits, and the machine as Markdown."""
    lines = ["| " + " | ".join(COLUMN_HEADINGS) + " |", "|---|---|---|---|---|"]
    lines += ["| " + " | ".join(format_cells(row)) + " |" for row in result["rows"]]
    lines += ["", *(f"- {line}" for line in result["slower"]), ""]
    lines += format_machine(result["machine"])
    for side, side_versions in result["versions"].items():
        lines.append(
            f"- {side}: "
            + ", ".join(f"{name} {version}" for name, version in side_versions.items())
        )
    return "\n".join([*lines, ""])
