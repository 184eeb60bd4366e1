"""Tables 5, 6 and 7 of the report with published and computed values."""

from collections.abc import Mapping

from dechirp.certificate import published
from dechirp.certificate.claim import Check, Claim
from dechirp.certificate.reference_trials import reference_radar
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.design.design import design


@frozen_dataclass
class TableRow:
    """Row of a table: a quantity with its published and its computed value."""

    quantity: str
    unit: str
    published: float | None
    computed: float | None


@frozen_dataclass
class Table:
    """Table of the report, with its number there."""

    number: int
    title: str
    published_label: str
    """Heading of the column of published values."""
    computed_label: str
    """Heading of the column of computed values."""
    rows: tuple[TableRow, ...]


def _table_row(
    quantity: str, unit: str, published_value: float | None, computed_value: float
) -> TableRow:
    return TableRow(
        quantity=quantity, unit=unit, published=published_value, computed=computed_value
    )


def build_report_tables(claims: Mapping[str, Claim]) -> tuple[Table, ...]:
    """Return the three tables; the last one contains results of the claims, given by id."""
    return _requirements_table(), _waveform_table(), _results_table(claims)


def _requirements_table() -> Table:
    frame = reference_radar().frame
    return Table(
        number=5,
        title="Requirements, and values of the reference radar",
        published_label="required",
        computed_label="reference radar",
        rows=(
            _table_row(
                "start frequency",
                "Hz",
                published.START_FREQUENCY_HZ,
                frame.chirp.start_frequency_hz,
            ),
            _table_row("largest range", "m", published.MAX_RANGE_M, frame.chirp.max_range_m),
            _table_row(
                "range bin width",
                "m",
                published.RANGE_RESOLUTION_M,
                frame.chirp.range_resolution_m,
            ),
            _table_row(
                "largest velocity",
                "m/s",
                published.MAX_VELOCITY_M_PER_S,
                frame.max_velocity_m_per_s,
            ),
            _table_row("velocity bin width", "m/s", None, frame.velocity_resolution_m_per_s),
        ),
    )


def _waveform_table() -> Table:
    exact_radar = design(
        max_range_m=published.MAX_RANGE_M,
        range_resolution_m=published.RANGE_RESOLUTION_M,
        max_velocity_m_per_s=published.MAX_VELOCITY_M_PER_S,
    ).radar
    chirp = exact_radar.frame.chirp
    return Table(
        number=6,
        title="Waveform design with a chirp of 5.5 round-trip times",
        published_label="published, c = 3e8 m/s",
        computed_label="exact c, integer number of samples",
        rows=(
            _table_row("bandwidth", "Hz", published.BANDWIDTH_HZ, chirp.sampled_bandwidth_hz),
            _table_row(
                "round-trip time of the largest range",
                "s",
                2 * published.MAX_RANGE_M / published.SPEED_OF_LIGHT,
                2 * published.MAX_RANGE_M / SPEED_OF_LIGHT,
            ),
            _table_row("chirp duration", "s", published.CHIRP_DURATION_S, chirp.ramp_duration_s),
            _table_row("slope", "Hz/s", published.SLOPE_HZ_PER_S, chirp.slope_hz_per_s),
            _table_row("sample rate", "Hz", published.SAMPLE_RATE_HZ, chirp.sample_rate_hz),
            _table_row("samples per chirp", "1", published.N_SAMPLES, chirp.n_samples),
            _table_row("chirps per frame", "1", published.N_CHIRPS, exact_radar.frame.n_chirps),
        ),
    )


def _results_table(claims: Mapping[str, Claim]) -> Table:
    range_check, velocity_check = claims["range_doppler_peak"].checks
    limit_check = claims["snr_limit"].checks[0]

    def row(quantity: str, check: Check, published_value: float | None) -> TableRow:
        return TableRow(
            quantity=quantity, unit=check.unit, published=published_value, computed=check.measured
        )

    return Table(
        number=7,
        title="Results for the car at 50 m and 10 m/s",
        published_label="published",
        computed_label="measured in this run",
        rows=(
            row("range", range_check, published.RANGE_M),
            row("velocity", velocity_check, published.VELOCITY_M_PER_S),
            row(
                "RMSE of range at -24 dB",
                claims["range_rmse"].checks[0],
                published.RANGE_ERROR_M,
            ),
            row(
                "RMSE of velocity at -24 dB",
                claims["velocity_rmse"].checks[0],
                published.VELOCITY_ERROR_M_PER_S,
            ),
            row("SNR limit per sample", limit_check, published.LOWEST_SNR_DB),
        ),
    )
