"""Block sums of tones against sums over all their samples."""

import numpy as np
import pytest

from dechirp.processing.tone_block_sums import (
    block_edges,
    demodulated_block_sums,
    subtract_tone,
    walk_phase_pattern,
)

INTERVAL_RATIO = 1 / 350
FORMS = pytest.mark.parametrize("form", ["compiled", "plain"])


def select_form(kernel, form):
    return kernel if form == "compiled" else kernel.plain


def sum_blocks(samples, rows, columns):
    """Sum samples (chirp, channel, sample) over blocks, (channel, rows, columns)."""
    over_samples = np.add.reduceat(samples, columns[:-1], axis=2)
    return np.add.reduceat(over_samples, rows[:-1], axis=0).transpose(1, 0, 2)


def centred(n_points):
    return np.arange(n_points) - (n_points - 1) / 2


@FORMS
@pytest.mark.parametrize("shape", [(1, 256), (128, 1), (3, 7), (17, 100), (100, 17), (128, 256)])
@pytest.mark.parametrize(("n_cells", "tolerance"), [(0, 1e-11), (0.5, 1e-5), (2, 3e-4)])
def test_tone_that_walks_and_grows_is_subtracted(shape, n_cells, tolerance, form):
    """Errors of the series are the third order of 0.2 rad a cell: 4e-6 and 1.3e-4 of a block."""
    n_chirps, n_samples = shape
    rows, columns = block_edges(n_chirps), block_edges(n_samples)
    walk = 2 * np.pi * n_cells / (n_chirps * n_samples)
    slow, fast = 2 * np.pi * np.array([0.3, 16.3]) / np.array(shape)
    channel_fast = np.array([0.01, -0.02]) * 2 * np.pi / n_samples
    amplitude, growth = np.array([1 + 0.3j, -0.5j]), 0.02 / n_chirps
    m, n = centred(n_chirps)[:, None, None], centred(n_samples)
    phase = slow * np.arange(n_chirps)[:, None, None] + fast * np.arange(n_samples)
    phase = phase + channel_fast[:, None] * n + walk * (m + INTERVAL_RATIO * n) * n
    sums = sum_blocks(amplitude[:, None] * (1 + growth * m) * np.exp(1j * phase), rows, columns)
    compensated = 0.4 * walk  # at the middle of blocks
    sums *= np.exp(-1j * compensated * walk_phase_pattern(rows, columns, INTERVAL_RATIO))

    select_form(subtract_tone, form)(
        sums, amplitude, slow, fast, channel_fast, walk, walk - compensated, growth,
        INTERVAL_RATIO, rows, columns,
    )  # fmt: skip

    block_size = np.diff(rows).max() * np.diff(columns).max()
    neglected_rad = walk * INTERVAL_RATIO * (np.diff(columns).max() / 2) ** 2
    assert abs(sums).max() < (tolerance + neglected_rad) * block_size


def simulate_echo(shape, slow, fast, walk):
    n_chirps, n_samples = shape
    m, n = centred(n_chirps)[:, None, None], centred(n_samples)
    phase = slow * np.arange(n_chirps)[:, None, None] + fast * np.arange(n_samples)
    return np.exp(1j * (phase + walk * (m + INTERVAL_RATIO * n) * n))


@FORMS
@pytest.mark.parametrize("is_complex", [True, False])
@pytest.mark.parametrize("n_cells", [0, 20, -20])
def test_walk_is_compensated_within_blocks(is_complex, n_cells, form):
    """A walk of 20 cells turns the phase by 4 rad from the middle of a block to its corner."""
    n_chirps, n_samples = 100, 250
    rows, columns = block_edges(n_chirps), block_edges(n_samples)
    walk = 2 * np.pi * n_cells / (n_chirps * n_samples)
    echo = simulate_echo((n_chirps, n_samples), 0.4, 0.7, walk)
    echo = np.concatenate([echo, np.zeros_like(echo)], axis=1)  # two channels, one without an echo
    samples = echo.astype(np.complex64) if is_complex else (2 * echo.real).astype(np.float32)

    sums = select_form(demodulated_block_sums, form)(
        samples.view(np.float32), n_samples, 0.4, 0.7, walk, INTERVAL_RATIO, rows, columns
    )

    sums *= np.exp(-1j * walk * walk_phase_pattern(rows, columns, INTERVAL_RATIO))
    n_points = np.multiply.outer(np.diff(rows), np.diff(columns))
    # The motion within a chirp within a block, walk i q^2, is left out: 1e-3 rad for 20 cells. The
    # image of real samples adds up to 1 / sin(f) over the samples of a block, f the frequency in a
    # row of blocks, 0.45 to 0.95 rad.
    tolerance = (1e-6 if n_cells == 0 else 1e-3) + (0 if is_complex else 0.16)
    np.testing.assert_allclose(sums[0] / n_points, 1, atol=tolerance)
    assert not sums[1].any()


@FORMS
@pytest.mark.parametrize("n_cells", [(8, 8), (0, 2), (2, 0), (-9, -8)])
@pytest.mark.parametrize("apart_bins", [(16.3, 16.3), (0.0, 16.2), (4.0, 16.0)])
def test_tone_is_subtracted_from_sums_with_compensated_walk(n_cells, apart_bins, form):
    """The error is that of the difference of both walks: 1e-4 of a block for two cells."""
    shape = n_chirps, n_samples = 128, 256
    rows, columns = block_edges(n_chirps), block_edges(n_samples)
    walk, compensated = 2 * np.pi * np.array(n_cells) / (n_chirps * n_samples)
    slow, fast = 2 * np.pi * np.array(apart_bins) / np.array(shape)
    echo = simulate_echo(shape, 0.4 + slow, 0.7 + fast, walk).astype(np.complex64)
    sums = select_form(demodulated_block_sums, form)(
        echo.view(np.float32), n_samples, 0.4, 0.7, compensated, INTERVAL_RATIO, rows, columns
    )
    sums *= np.exp(-1j * compensated * walk_phase_pattern(rows, columns, INTERVAL_RATIO))

    select_form(subtract_tone, form)(
        sums, np.ones(1, complex), slow, fast, np.zeros(1), walk - compensated, walk - compensated,
        0.0, INTERVAL_RATIO, rows, columns,
    )  # fmt: skip

    assert abs(sums).max() < 5e-4 * 8 * 16
