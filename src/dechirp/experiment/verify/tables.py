"""The report's tables 5, 6 and 7: as published, and as they come out here."""

from collections.abc import Mapping

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.experiment.verify import published
from dechirp.experiment.verify.claim import Check, Claim
from dechirp.experiment.verify.looks import radar
from dechirp.radar.design import design


@value
class Row:
    """One quantity of a table."""

    quantity: str
    unit: str
    published: float | None
    here: float | None


@value
class Table:
    """A table of the report, by its number there."""

    number: int
    title: str
    published: str
    """What the column of published figures holds."""
    here: str
    """What the other column holds."""
    rows: tuple[Row, ...]


def _row(quantity: str, unit: str, said: float | None, here: float) -> Row:
    return Row(quantity=quantity, unit=unit, published=said, here=here)


def tables(claims: Mapping[str, Claim]) -> tuple[Table, ...]:
    """All three; the last one from the claims, by id."""
    return _requirements(), _waveform(), _results(claims)


def _requirements() -> Table:
    frame = radar().frame
    return Table(
        number=5,
        title="Requirements, and what the reference radar reaches",
        published="required",
        here="reached",
        rows=(
            _row("carrier", "Hz", published.START_FREQUENCY_HZ, frame.chirp.start_frequency_hz),
            _row("largest range", "m", published.MAX_RANGE_M, frame.chirp.max_range_m),
            _row(
                "width of a range bin",
                "m",
                published.RANGE_RESOLUTION_M,
                frame.chirp.range_resolution_m,
            ),
            _row(
                "largest velocity",
                "m/s",
                published.MAX_VELOCITY_M_PER_S,
                frame.max_velocity_m_per_s,
            ),
            _row("width of a velocity bin", "m/s", None, frame.velocity_resolution_m_per_s),
        ),
    )


def _waveform() -> Table:
    exact = design(
        max_range_m=published.MAX_RANGE_M,
        range_resolution_m=published.RANGE_RESOLUTION_M,
        max_velocity_m_per_s=published.MAX_VELOCITY_M_PER_S,
    ).radar
    chirp = exact.frame.chirp
    return Table(
        number=6,
        title="The waveform that meets them, by 5.5 round trips",
        published="published, c = 3e8 m/s",
        here="designed with the exact c, whole samples",
        rows=(
            _row("bandwidth", "Hz", published.BANDWIDTH_HZ, chirp.sampled_bandwidth_hz),
            _row(
                "round trip to the largest range",
                "s",
                2 * published.MAX_RANGE_M / published.SPEED_OF_LIGHT,
                2 * published.MAX_RANGE_M / SPEED_OF_LIGHT,
            ),
            _row("duration of the chirp", "s", published.CHIRP_DURATION_S, chirp.ramp_duration_s),
            _row("slope", "Hz/s", published.SLOPE_HZ_PER_S, chirp.slope_hz_per_s),
            _row("sample rate", "Hz", published.SAMPLE_RATE_HZ, chirp.sample_rate_hz),
            _row("samples of a chirp", "1", published.N_SAMPLES, chirp.n_samples),
            _row("chirps of a frame", "1", published.N_CHIRPS, exact.frame.n_chirps),
        ),
    )


def _results(claims: Mapping[str, Claim]) -> Table:
    at, moving = claims["range_doppler_peak"].checks
    limit = claims["snr_limit"].checks[0]

    def row(quantity: str, check: Check, said: float | None) -> Row:
        return Row(quantity=quantity, unit=check.unit, published=said, here=check.measured)

    return Table(
        number=7,
        title="What was found of the car at 50 m and 10 m/s",
        published="published",
        here="measured in this run",
        rows=(
            row("range", at, published.RANGE_M),
            row("velocity", moving, published.VELOCITY_M_PER_S),
            row(
                "error of range, root mean square at -24 dB",
                claims["range_rmse"].checks[0],
                published.RANGE_ERROR_M,
            ),
            row(
                "error of velocity, root mean square at -24 dB",
                claims["velocity_rmse"].checks[0],
                published.VELOCITY_ERROR_M_PER_S,
            ),
            row("lowest ratio in each sample", limit, published.LOWEST_SNR_DB),
        ),
    )
