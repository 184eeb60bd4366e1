"""`dechirp fixed-point`: one frame in fixed-point arithmetic, with test vectors."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import NO_OPTIONS, Json, Quiet, RecordingOptions

if TYPE_CHECKING:
    import xarray as xr

    from dechirp.processing.fixed_point.comparison import DetectionAgreement
    from dechirp.processing.fixed_point.word_lengths import WordLengths


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
    options: RecordingOptions = NO_OPTIONS,
) -> int:
    """Process one frame in fixed-point arithmetic and write test vectors.

    Transform lengths are powers of two: other lengths are zero-padded unless they are set.

    Parameters
    ----------
    source
        Scenario (YAML) or recording (file or folder); the reference scenario by default.
    words
        Word lengths (YAML), such as `range_bits: 18`; 16 bits in both transforms by default.
    frame
        Frame number, counted from 0.
    out
        Folder for the test vectors: hex files and vectors.json. Existing ones are replaced.
    seed
        Seed of the noise; replaces the seed of the scenario.
    changes
        PATH=VALUE changes a setting, such as chain.n_range_bins=4096; may be repeated.
    """
    from dechirp.cli.errors import replace_settings_by_options
    from dechirp.cli.scenario_source import build_scenario
    from dechirp.config import loading
    from dechirp.core.errors import DechirpError
    from dechirp.experiments.run import simulate_or_read_frame_and_radar
    from dechirp.processing.fixed_point.chain import fixed_point_map
    from dechirp.processing.fixed_point.comparison import compare_detections
    from dechirp.processing.fixed_point.lookup_tables import pad_to_powers_of_two
    from dechirp.processing.fixed_point.word_lengths import WordLengths
    from dechirp.processing.range_doppler_map import power_map, threshold_map
    from dechirp.results.hex_vectors import check_vector_folder_replaceable, write_vectors
    from dechirp.results.text_files import to_json_text

    check_vector_folder_replaceable(out)
    lengths = WordLengths() if words is None else loading.read_settings(words, WordLengths)
    scenario = build_scenario(
        source,
        changes=changes or [],
        radar=options.radar,
        frames=options.frames,
        seed=seed,
        metadata=options.given_metadata(),
    )
    try:
        cube, radar = simulate_or_read_frame_and_radar(scenario, frame)
        chain = pad_to_powers_of_two(scenario.chain, radar).fit_to_radar(radar)
        stages = fixed_point_map(cube, radar, chain, lengths)
    except DechirpError as error:
        raise replace_settings_by_options(error, OPTION_BY_SETTING) from None
    power = power_map(cube, radar, chain)
    compared = compare_detections(stages, power, threshold_map(power, radar, chain))
    files = write_vectors(out, cube, radar, chain, lengths)
    document = to_json_text(_fixed_point_comparison_document(stages, compared, lengths, files))
    if as_json:
        print(document, end="")
    elif not quiet:
        _print_fixed_point_comparison(stages, compared, out)
    return 0


OPTION_BY_SETTING = {
    "frame": "--frame",
    **{
        f"Chain.{name}": f"chain.{name}"
        for name in ("cfar.estimator", "range_walk", "n_range_bins", "n_velocity_bins")
    },
}
"""Options by the names of settings in error messages."""


GUIDE_ADDRESS = "https://dechirp.readthedocs.io/en/latest/silicon.html"


def _fixed_point_comparison_document(
    dataset: "xr.Dataset",
    compared: "DetectionAgreement",
    words: "WordLengths",
    files: dict[str, Path],
) -> dict[str, Any]:
    from dechirp.config.dumping import to_json_data

    stages = dataset.overflows.stage.values.tolist()
    return {
        "words": to_json_data(words),
        "overflows": dict(zip(stages, dataset.overflows.values.tolist(), strict=True)),
        **compared._asdict(),
        "files": {name: str(path) for name, path in files.items()},
    }


def _print_fixed_point_comparison(
    stages: "xr.Dataset", compared: "DetectionAgreement", out: Path
) -> None:
    from dechirp.cli.console import new_table, open_stdout_console

    screen = open_stdout_console()
    rows = new_table(
        "cells over threshold", number_columns=["fixed point", "floating point", "only one"]
    )
    rows.add_row(*(str(n) for n in compared[:3]))
    screen.print(rows)
    if compared.n_only_one:
        screen.print(f"These cells lie within {compared.farthest_db:.2g} dB of their threshold.")
    n_over = int(stages.overflows.sum())
    screen.print(f"{n_over} words saturated." if n_over else "No word overflowed.")
    screen.print(f"Vectors: {out}")
    screen.print(f"Source code of this chain: dechirp generate; see {GUIDE_ADDRESS}")
