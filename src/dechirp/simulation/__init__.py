"""Simulation of FMCW radars: from a scene to the samples of the ADC.

The transmitter sends linear ramps of the start frequency f0 and the slope S. A scatterer at p
returns each ramp after the delay tau; mixed with the ramp being sent, it becomes a tone, the beat
signal (Stove 1992). Transmitter k and receiver l, at the time t_n on the ramp, yield

    s_kl(t) = sum over scatterers of
        a g_k g_l / (|p - tx_k| |p - rx_l|)  exp 2 pi i (f0 tau + S tau t_n - S tau^2 / 2),
    tau = (|p(t) - tx_k| + |p(t) - rx_l|) / c,

and receiver l samples sum_k w_mk s_kl in chirp m, with the code w of the transmitters. The
amplitude a follows from the radar equation: a^2 = P_t lambda^2 sigma / ((4 pi)^3 L), with the
antenna gains g_k^2 and g_l^2. Real sampling keeps sqrt(2) Re s.

A frame passes these steps:

1. `scene/trajectories.py` fits polynomials of time to the paths p(t).
2. `echo_groups.py` collects scatterers, amplitudes and gains for each run of equal ramps.
3. `impairments/`, stage Propagation, adds or attenuates echoes: walls, road, rain, coupling
   (`mirror_images.py`, `path_attenuation.py`); `path_shadowing.py` then applies the shadows of
   bodies and walls.
4. `kernels/selection.py` predicts the cheapest kernel and sums the echoes with it:
   `kernels/direct.py` echo by echo, `kernels/low_rank.py` as a product of chirps and fast time,
   `kernels/nufft.py` by non-uniform Fourier transforms. `engine.py` holds the settings.
5. `impairments/`, stage Oscillator, yields a phase error phi; `phase_error.py` multiplies every
   echo by exp i (phi(t) - phi(t - tau)).
6. `impairments/`, stage Receiver, filters, compresses, adds noise and quantises
   (`frequency_response.py`, `blocks.py`, `adc_codes.py`).

`stages.py` sorts impairments into these stages, `simulate.py` runs them, `monte_carlo.py` repeats
them for trials of one scene, and `frame_by_frame.py` simulates single frames on demand.
"""
