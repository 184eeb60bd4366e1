"""`dechirp generate`: source code that equals the fixed-point chain bit for bit."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dechirp.cli.options import NO_OPTIONS, Json, Quiet, RecordingOptions

if TYPE_CHECKING:
    from dechirp.experiments.scenario import Scenario
    from dechirp.generators.base import Generator
    from dechirp.radar.radar import Radar


def generate(
    language: str,
    source: Path | None = None,
    /,
    *,
    out: Path,
    words: Annotated[Path | None, Parameter(name="--words")] = None,
    prefix: str = "radar",
    as_json: Json = False,
    quiet: Quiet = False,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
    options: RecordingOptions = NO_OPTIONS,
) -> int:
    """Write source code of the fixed-point chain, equal bit for bit to `dechirp fixed-point`.

    Transform lengths are powers of two: other lengths are zero-padded unless they are set.

    Parameters
    ----------
    language
        Language of the code: c or verilog.
    source
        Scenario (YAML) or recording (file or folder); the reference scenario by default.
    out
        Folder for the source files. An earlier one is replaced.
    words
        Word lengths (YAML), such as `range_bits: 18`; 16 bits in both transforms by default.
    prefix
        Start of all names in the code.
    changes
        PATH=VALUE changes a setting, such as chain.n_range_bins=4096; may be repeated.
    """
    from dechirp.cli.commands.fixed_point import GUIDE_ADDRESS
    from dechirp.cli.errors import replace_settings_by_options
    from dechirp.cli.scenario_source import build_scenario
    from dechirp.config import loading
    from dechirp.core.errors import DechirpError
    from dechirp.processing.fixed_point.word_lengths import WordLengths
    from dechirp.results.text_files import to_json_text

    lengths = WordLengths() if words is None else loading.read_settings(words, WordLengths)
    scenario = build_scenario(
        source,
        changes=changes or [],
        radar=options.radar,
        frames=options.frames,
        seed=None,
        metadata=options.given_metadata(),
    )
    try:
        generator = _make_generator(language, prefix)
        radar = _radar_of_scenario(scenario)
        files = generator.write(out, radar, scenario.chain, lengths)
    except DechirpError as error:
        raise replace_settings_by_options(error, _option_by_setting()) from None
    if as_json:
        document = {
            "language": language,
            "files": {name: str(path) for name, path in files.items()},
        }
        print(to_json_text(document), end="")
    elif not quiet:
        print(f"Written: {out}, {len(files)} files")
        print(f"Test vectors: dechirp fixed-point with the same settings; see {GUIDE_ADDRESS}")
    return 0


def _option_by_setting() -> dict[str, str]:
    """Return the options by the names of settings in error messages."""
    from dechirp.cli.commands.fixed_point import OPTION_BY_SETTING
    from dechirp.generators.base import Generator

    members = Generator.members().values()
    return OPTION_BY_SETTING | {f"{member.__name__}.prefix": "--prefix" for member in members}


def _make_generator(language: str, prefix: str) -> "Generator":
    from dechirp.core.errors import InvalidSetting
    from dechirp.core.suggestions import did_you_mean_fix
    from dechirp.generators.base import Generator

    members: dict[str, type[Generator]] = Generator.members()
    if language not in members:
        raise InvalidSetting(
            "LANGUAGE",
            value=language,
            expected=f"one of {', '.join(members)}",
            fix=did_you_mean_fix(language, members),
        )
    return members[language](prefix=prefix)


def _radar_of_scenario(scenario: "Scenario") -> "Radar":
    """Return the radar of a simulated scene, or that of the first frame of a recording."""
    from dechirp.experiments.recording_stage import open_scenario_recording

    if scenario.recording is None:
        assert scenario.radar is not None
        return scenario.radar
    return open_scenario_recording(scenario).radar.for_frame(0)
