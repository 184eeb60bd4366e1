"""Waveform design: from requirements to a chirp and a frame, with every formula.

    Choice                  Equation                                        File
    ----------------------  ----------------------------------------------  -----------------
    bandwidth               B = c / 2 dR                                    both rules
    interval, constraints   T = lambda / 4 v                                `by_constraints`
    sampling, constraints   T - idle - 2 R / c - settling - margin          `by_constraints`
    samples, constraints    N = (R / dR + 1/2) / usable band                `by_constraints`
    chirp, round trips      T = 5.5 x 2 R / c, sampled at fs = 2 B          `by_round_trips`
    chirps of a frame       M = lambda / (2 T dv)                           `common`
    detection range         R (snr / required snr)^(1/4)                    `detection_range`
    rates, sizes, powers    8 N M n_rx words / M T, P Gt T_ramp / T, ...    `derived`

`design` runs a rule; `relaxation` finds the requirement that has to give where not all can be
met.
"""
