"""`dechirp fixed-point`: one frame through the chain in whole numbers, and vectors for a bench."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import NOTHING_TOLD, Json, Quiet, Told

if TYPE_CHECKING:
    import xarray as xr

    from dechirp.process.fixed_point.agreement import Agreement
    from dechirp.process.fixed_point.words import WordLengths


def fixed_point(
    source: Path | None = None,
    /,
    *,
    words: Annotated[Path | None, Parameter(name="--words")] = None,
    frame: int = 0,
    out: Path = Path("dechirp-fixed-point"),
    as_json: Json = False,
    quiet: Quiet = False,
    seed: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
    told: Told = NOTHING_TOLD,
) -> int:
    """Take one frame through the chain in words of given lengths, and write test vectors.

    Transforms are powers of two long: others are padded unless their lengths are set.

    Parameters
    ----------
    source
        Scenario (YAML), or recording (file or folder); the reference scenario without it.
    words
        Word lengths (YAML), as `range_bits: 18`; 16 bits in both transforms without it.
    frame
        Which frame, counted from 0.
    out
        Folder for the vectors: hex files and vectors.json. Earlier ones in it are replaced.
    seed
        Seed of the noise, in place of the scenario's.
    changes
        PATH=VALUE changes a setting, as chain.n_range_bins=4096; may be repeated.
    """
    from dechirp.cli.sources import scenario_of
    from dechirp.cli.wrong import under_option
    from dechirp.config import files
    from dechirp.core.errors import DechirpError
    from dechirp.experiment.run import one_frame
    from dechirp.process.fixed_point.agreement import agreement
    from dechirp.process.fixed_point.chain import fixed_point_map
    from dechirp.process.fixed_point.tables import padded
    from dechirp.process.fixed_point.words import WordLengths
    from dechirp.process.maps import power_map, threshold_map
    from dechirp.store.hex_vectors import check_out, write_vectors
    from dechirp.store.tables import json_text

    check_out(out)
    lengths = WordLengths() if words is None else files.read(words, WordLengths)
    scenario = scenario_of(
        source,
        changes=changes or [],
        radar=told.radar,
        frames=told.frames,
        seed=seed,
        told=told.of_file(),
    )
    try:
        cube, radar = one_frame(scenario, frame)
        chain = padded(scenario.chain, radar).fitted(radar)
        made = fixed_point_map(cube, radar, chain, lengths)
    except DechirpError as error:
        raise under_option(error, _NAMES) from None
    power = power_map(cube, radar, chain)
    compared = agreement(made, power, threshold_map(power, radar, chain))
    written = write_vectors(out, cube, radar, chain, lengths)
    document = json_text(_document(made, compared, lengths, written))
    if as_json:
        print(document, end="")
    elif not quiet:
        _show(made, compared, out)
    return 0


_NAMES = {
    "frame": "--frame",
    **{
        f"Chain.{name}": f"chain.{name}"
        for name in ("cfar.estimator", "range_walk", "n_range_bins", "n_velocity_bins")
    },
}
"""What the settings of the functions are called here."""


def _document(
    made: "xr.Dataset", compared: "Agreement", words: "WordLengths", files: dict[str, Path]
) -> dict[str, Any]:
    from dechirp.config.texts import plain

    stages = made.overflows.stage.values.tolist()
    return {
        "words": plain(words),
        "overflows": dict(zip(stages, made.overflows.values.tolist(), strict=True)),
        **compared._asdict(),
        "files": {name: str(path) for name, path in files.items()},
    }


def _show(made: "xr.Dataset", compared: "Agreement", out: Path) -> None:
    from dechirp.cli.show import console, table

    screen = console()
    rows = table("cells over threshold", right=["whole numbers", "floating point", "only one"])
    rows.add_row(*(str(n) for n in compared[:3]))
    screen.print(rows)
    if compared.n_only_one:
        screen.print(f"Those lie within {compared.farthest_db:.2g} dB of their threshold.")
    n_over = int(made.overflows.sum())
    screen.print(f"{n_over} words saturated." if n_over else "No word overflowed.")
    screen.print(f"Vectors: {out}", soft_wrap=True)
