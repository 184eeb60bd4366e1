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
            Row(quantity="carrier", unit="Hz", published=77e9, here=_carrier_hz()),
            Row(
                quantity="largest range",
                unit="m",
                published=published.MAX_RANGE_M,
                here=frame.chirp.max_range_m,
            ),
            Row(
                quantity="width of a range bin",
                unit="m",
                published=published.RANGE_RESOLUTION_M,
                here=frame.chirp.range_resolution_m,
            ),
            Row(
                quantity="largest velocity",
                unit="m/s",
                published=published.MAX_VELOCITY_M_PER_S,
                here=frame.max_velocity_m_per_s,
            ),
            Row(
                quantity="width of a velocity bin",
                unit="m/s",
                published=None,
                here=frame.velocity_resolution_m_per_s,
            ),
        ),
    )


def _carrier_hz() -> float:
    return radar().frame.chirp.start_frequency_hz


def _waveform() -> Table:
    exact = design(
        max_range_m=published.MAX_RANGE_M,
        range_resolution_m=published.RANGE_RESOLUTION_M,
        max_velocity_m_per_s=published.MAX_VELOCITY_M_PER_S,
    ).radar
    chirp = exact.frame.chirp
    rounded_s = 2 * published.MAX_RANGE_M / published.SPEED_OF_LIGHT
    bandwidth_hz = published.SPEED_OF_LIGHT / (2 * published.RANGE_RESOLUTION_M)
    return Table(
        number=6,
        title="The waveform that meets them, by 5.5 round trips",
        published="with c = 3e8 m/s",
        here="designed with the exact c, whole samples",
        rows=(
            Row(
                quantity="bandwidth",
                unit="Hz",
                published=bandwidth_hz,
                here=chirp.sampled_bandwidth_hz,
            ),
            Row(
                quantity="round trip to the largest range",
                unit="s",
                published=rounded_s,
                here=2 * published.MAX_RANGE_M / SPEED_OF_LIGHT,
            ),
            Row(
                quantity="duration of the chirp",
                unit="s",
                published=5.5 * rounded_s,
                here=chirp.ramp_duration_s,
            ),
            Row(
                quantity="slope",
                unit="Hz/s",
                published=bandwidth_hz / (5.5 * rounded_s),
                here=chirp.slope_hz_per_s,
            ),
            Row(
                quantity="sample rate",
                unit="Hz",
                published=radar().frame.chirp.sample_rate_hz,
                here=chirp.sample_rate_hz,
            ),
            Row(
                quantity="samples of a chirp",
                unit="1",
                published=radar().frame.chirp.n_samples,
                here=chirp.n_samples,
            ),
            Row(
                quantity="chirps of a frame",
                unit="1",
                published=radar().frame.n_chirps,
                here=exact.frame.n_chirps,
            ),
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
