"""
Word lengths of a fixed-point transform
=======================================

Each stage of a transform in whole numbers rounds, and what that leaves of the signal grows by
6.02 dB a bit (Welch, IEEE T-AU 17, 1969). See tones and noise through 256 points in words of 8 to
24 bits, on the lines of theory; those hold from 12 bits on, for at 8 small numbers round to 0.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

ratios = dc.fixed_point.signal_to_quantisation_noise_over_bits(
    (8, 12, 16, 20, 24), n_trials=10, seed=1
)
figure, axes = plt.subplots()
for place, signal in enumerate(ratios.signal.values):
    one = ratios.sel(signal=signal)
    axes.plot(one.bits, 10 * np.log10(one.predicted), color=f"C{place}")
    axes.plot(one.bits, 10 * np.log10(one.measured), "o", color=f"C{place}", label=str(signal))
axes.set(xlabel="Bits per real or imaginary part", ylabel="Signal-to-quantisation-noise ratio (dB)")
axes.set_title("A transform of 256 points with block scaling; lines: theory")
axes.legend()
step_db = 10 * np.log10(ratios.measured.sel(bits=24) / ratios.measured.sel(bits=12)) / 12
print(f"{step_db.mean().item():.2f} dB a bit")
