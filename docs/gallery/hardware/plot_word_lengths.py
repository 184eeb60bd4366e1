"""
Word lengths of a fixed-point transform
=======================================

Each stage of a fixed-point transform rounds; the signal-to-quantisation-noise ratio grows by
6.02 dB per bit (Welch, IEEE T-AU 17, 1969). The figure compares tones and noise through 256
points, with words of 8 to 24 bits, with theory. Theory holds from 12 bits; at 8 bits small values
round to zero.
"""

import matplotlib.pyplot as plt
import numpy as np

import dechirp as dc

ratios = dc.fixed_point.signal_to_quantisation_noise_over_bits(
    (8, 12, 16, 20, 24), n_trials=10, seed=1
)
figure, axes = plt.subplots()
for index, signal in enumerate(ratios.signal.values):
    curve = ratios.sel(signal=signal)
    axes.plot(curve.bits, 10 * np.log10(curve.predicted), color=f"C{index}")
    axes.plot(curve.bits, 10 * np.log10(curve.measured), "o", color=f"C{index}", label=str(signal))
axes.set(xlabel="Word length (bits per part)", ylabel="SQNR (dB)")
axes.set_title("A transform of 256 points with block scaling; lines: theory")
axes.legend()
step_db = 10 * np.log10(ratios.measured.sel(bits=24) / ratios.measured.sel(bits=12)) / 12
print(f"{step_db.mean().item():.2f} dB per bit")
