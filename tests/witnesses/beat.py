"""The law of the beat signal, sample by sample: in 50 digits, and as a plain sum."""

import mpmath
import numpy as np

LIGHT = 299_792_458


def fifty_digits(scatterers, sent, m, k, n, *, late="held", before=None):
    """One sample of chirp m on receiver k: the sum of all echoes, and of their sizes."""
    total, size = mpmath.mpc(0), mpmath.mpf(0)
    with mpmath.workdps(50):
        mpf = mpmath.mpf
        t = mpf(sent.adc_start_s) + mpf(int(n)) / mpf(sent.sample_rate_hz)
        at_s = mpf(sent.starts_s[m]) + t
        f0, slope = mpf(sent.start_frequency_hz), mpf(sent.slope_hz_per_s)
        for i in range(len(scatterers.amplitudes)):
            at_m = [
                mpmath.fsum(
                    mpf(term[i, axis]) * at_s**power for power, term in enumerate(scatterers.path_m)
                )
                for axis in range(3)
            ]
            back = mpmath.norm([x - mpf(y) for x, y in zip(at_m, sent.rx_m[k], strict=True)])
            for j, tx_m in enumerate(sent.tx_m):
                there = mpmath.norm([x - mpf(y) for x, y in zip(at_m, tx_m, strict=True)])
                tau = (there + back) / LIGHT
                amplitude = mpf(scatterers.amplitudes[i]) / (there * back)
                amplitude *= mpf(scatterers.tx_gains[j, i]) * mpf(scatterers.rx_gains[k, i])
                if scatterers.chirp_factors is not None:
                    amplitude *= mpf(scatterers.chirp_factors[m, i])
                echoes = []
                if late == "held" or t >= tau:
                    echoes.append((sent.weights[m, j], tau))
                elif late == "tail" and not np.isnan(before.gaps_s[m]):
                    # On the time of the ramp before, which began a gap earlier.
                    late_s = tau - mpf(before.gaps_s[m])
                    if 0 <= t - late_s < mpf(before.ramp_duration_s):
                        echoes.append((before.weights[m, j], late_s))
                for weight, u in echoes:
                    cycles = f0 * u + slope * u * t - slope * u**2 / 2
                    phasor = mpmath.expjpi(2 * (cycles - mpmath.floor(cycles)))
                    total += mpmath.mpc(complex(weight)) * amplitude * phasor
                    size += abs(complex(weight)) * amplitude
    return complex(total), float(size)


def plain_sum(scatterers, sent, n_samples, *, late="held"):
    """All samples, (chirp, rx, sample), by an exponential for each, and the sums of sizes."""
    real = np.longdouble  # where it has no more digits than a double, 1e-10 is still left
    turn = 2 * np.arccos(real(-1))
    shape = (len(sent.starts_s), len(sent.rx_m), n_samples)
    out, sizes = np.zeros(shape, np.clongdouble), np.zeros(shape)
    t = real(sent.adc_start_s) + np.arange(n_samples) / real(sent.sample_rate_hz)
    for m, start_s in enumerate(sent.starts_s):
        powers = (real(start_s) + t) ** np.arange(len(scatterers.path_m))[:, None]
        at_m = np.einsum("kia,kn->ain", scatterers.path_m.astype(real), powers)
        for k, rx_m in enumerate(sent.rx_m):
            back = np.sqrt(((at_m - rx_m[:, None, None]) ** 2).sum(axis=0))
            for j, tx_m in enumerate(sent.tx_m):
                there = np.sqrt(((at_m - tx_m[:, None, None]) ** 2).sum(axis=0))
                tau = (there + back) / LIGHT
                size = scatterers.amplitudes * scatterers.tx_gains[j] * scatterers.rx_gains[k]
                if scatterers.chirp_factors is not None:
                    size = size * scatterers.chirp_factors[m]
                size = size[:, None] / (there * back)
                if late == "onset":
                    size = np.where(t >= tau, size, 0)
                cycles = sent.start_frequency_hz * tau + sent.slope_hz_per_s * tau * (t - tau / 2)
                echoes = size * np.exp(1j * turn * (cycles - np.floor(cycles)))
                out[m, k] += sent.weights[m, j] * echoes.sum(axis=0)
                sizes[m, k] += (abs(sent.weights[m, j] * size)).sum(axis=0).astype(float)
    return out, sizes
