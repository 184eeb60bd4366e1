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


def sum_blocks(samples, rows, columns):
    """Sum samples (chirp, channel, sample) over blocks, (channel, rows, columns)."""
    over_samples = np.add.reduceat(samples, columns[:-1], axis=2)
    return np.add.reduceat(over_samples, rows[:-1], axis=0).transpose(1, 0, 2)


def centred(n_points):
    return np.arange(n_points) - (n_points - 1) / 2


@pytest.mark.parametrize("shape", [(1, 256), (128, 1), (3, 7), (17, 100), (100, 17), (128, 256)])
@pytest.mark.parametrize(("n_cells", "tolerance"), [(0, 1e-11), (0.5, 1e-5), (2, 3e-4)])
def test_tone_that_walks_and_grows_is_subtracted(shape, n_cells, tolerance):
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

    subtract_tone(
        sums, amplitude, slow, fast, channel_fast, walk, walk - compensated, growth,
        INTERVAL_RATIO, rows, columns,
    )  # fmt: skip

    block_size = np.diff(rows).max() * np.diff(columns).max()
    neglected_rad = walk * INTERVAL_RATIO * (np.diff(columns).max() / 2) ** 2
    assert abs(sums).max() < (tolerance + neglected_rad) * block_size


@pytest.mark.parametrize("is_complex", [True, False])
@pytest.mark.parametrize("n_cells", [0, 20])
def test_walk_is_compensated_within_blocks(is_complex, n_cells):
    """A walk of 20 cells turns the phase by 4 rad from the middle of a block to its side."""
    n_chirps, n_samples = 100, 250
    rows, columns = block_edges(n_chirps), block_edges(n_samples)
    walk = 2 * np.pi * n_cells / (n_chirps * n_samples)
    m, n = centred(n_chirps)[:, None, None], centred(n_samples)
    phase = 0.4 * np.arange(n_chirps)[:, None, None] + 0.7 * np.arange(n_samples)
    phase = phase + walk * (m + INTERVAL_RATIO * n) * n
    # A second channel without an echo.
    echo = np.concatenate([np.exp(1j * phase), np.zeros_like(phase)], axis=1)
    samples = (echo if is_complex else 2 * echo.real).astype(
        np.complex64 if is_complex else np.float32
    )

    sums = demodulated_block_sums(
        samples.view(np.float32), n_samples, 0.4, 0.7, walk, INTERVAL_RATIO, rows, columns
    )

    sums *= np.exp(-1j * walk * walk_phase_pattern(rows, columns, INTERVAL_RATIO))
    n_points = np.multiply.outer(np.diff(rows), np.diff(columns))
    # p q turns corners of blocks by 0.13 rad. The image of real samples adds up to 1 / sin(f) over
    # the samples of a block, f the frequency in a row of blocks, 0.45 to 0.95 rad.
    tolerance = (1e-6 if n_cells == 0 else 0.01) + (0 if is_complex else 0.16)
    np.testing.assert_allclose(sums[0] / n_points, 1, atol=tolerance)
    assert not sums[1].any()
