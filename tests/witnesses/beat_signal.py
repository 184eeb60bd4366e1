"""Reference beat signal, sample by sample: in 50 digits, and as a plain sum of exponentials."""

import mpmath
import numpy as np

SPEED_OF_LIGHT = 299_792_458


def sum_echoes_in_fifty_digits(scatterers, transmission, m, k, n, *, late="held", previous=None):
    """Return one sample of chirp m on receiver k: sum of all echoes, and sum of magnitudes."""
    total, size = mpmath.mpc(0), mpmath.mpf(0)
    with mpmath.workdps(50):
        mpf = mpmath.mpf
        t = mpf(transmission.adc_start_s) + mpf(int(n)) / mpf(transmission.sample_rate_hz)
        time_s = mpf(transmission.starts_s[m]) + t
        f0, slope = mpf(transmission.start_frequency_hz), mpf(transmission.slope_hz_per_s)
        for i in range(len(scatterers.amplitudes)):
            position_m = [
                mpmath.fsum(
                    mpf(term[i, axis]) * time_s**power
                    for power, term in enumerate(scatterers.path_m)
                )
                for axis in range(3)
            ]
            rx_distance = mpmath.norm(
                [x - mpf(y) for x, y in zip(position_m, transmission.rx_m[k], strict=True)]
            )
            for j, tx_m in enumerate(transmission.tx_m):
                tx_distance = mpmath.norm(
                    [x - mpf(y) for x, y in zip(position_m, tx_m, strict=True)]
                )
                tau = (tx_distance + rx_distance) / SPEED_OF_LIGHT
                amplitude = mpf(scatterers.amplitudes[i]) / (tx_distance * rx_distance)
                amplitude *= mpf(scatterers.tx_gains[j, i]) * mpf(scatterers.rx_gains[k, i])
                if scatterers.chirp_factors is not None:
                    amplitude *= mpf(scatterers.chirp_factors[m, i])
                echoes = []
                if late == "held" or t >= tau:
                    echoes.append((transmission.weights[m, j], tau))
                elif late == "tail" and not np.isnan(previous.gaps_s[m]):
                    # Time on the previous ramp, which began a gap earlier.
                    previous_delay_s = tau - mpf(previous.gaps_s[m])
                    if 0 <= t - previous_delay_s < mpf(previous.ramp_duration_s):
                        echoes.append((previous.weights[m, j], previous_delay_s))
                for weight, u in echoes:
                    cycles = f0 * u + slope * u * t - slope * u**2 / 2
                    phasor = mpmath.expjpi(2 * (cycles - mpmath.floor(cycles)))
                    total += mpmath.mpc(complex(weight)) * amplitude * phasor
                    size += abs(complex(weight)) * amplitude
    return complex(total), float(size)


def sum_echoes_plainly(scatterers, transmission, n_samples, *, late="held"):
    """Return all samples (chirp, rx, sample) as sums of exponentials, and sums of magnitudes."""
    extended = np.longdouble  # platforms without extended precision still give 1e-10
    two_pi = 2 * np.arccos(extended(-1))
    shape = (len(transmission.starts_s), len(transmission.rx_m), n_samples)
    out, sizes = np.zeros(shape, np.clongdouble), np.zeros(shape)
    t = extended(transmission.adc_start_s) + np.arange(n_samples) / extended(
        transmission.sample_rate_hz
    )
    for m, start_s in enumerate(transmission.starts_s):
        powers = (extended(start_s) + t) ** np.arange(len(scatterers.path_m))[:, None]
        position_m = np.einsum("kia,kn->ain", scatterers.path_m.astype(extended), powers)
        for k, rx_m in enumerate(transmission.rx_m):
            rx_distance = np.sqrt(((position_m - rx_m[:, None, None]) ** 2).sum(axis=0))
            for j, tx_m in enumerate(transmission.tx_m):
                tx_distance = np.sqrt(((position_m - tx_m[:, None, None]) ** 2).sum(axis=0))
                tau = (tx_distance + rx_distance) / SPEED_OF_LIGHT
                size = scatterers.amplitudes * scatterers.tx_gains[j] * scatterers.rx_gains[k]
                if scatterers.chirp_factors is not None:
                    size = size * scatterers.chirp_factors[m]
                size = size[:, None] / (tx_distance * rx_distance)
                if late == "onset":
                    size = np.where(t >= tau, size, 0)
                cycles = (
                    transmission.start_frequency_hz * tau
                    + transmission.slope_hz_per_s * tau * (t - tau / 2)
                )
                echoes = size * np.exp(1j * two_pi * (cycles - np.floor(cycles)))
                out[m, k] += transmission.weights[m, j] * echoes.sum(axis=0)
                sizes[m, k] += (abs(transmission.weights[m, j] * size)).sum(axis=0).astype(float)
    return out, sizes
