"""Radar parameters, the equations that follow from them, the link budget and waveform design.

    Quantity                  Equation                                     File
    ------------------------  -------------------------------------------  ----------------------
    beat frequency            f_b = 2 S R / c                              `chirp`
    range of a beat           R = c f_b / 2 S                              `chirp`
    range resolution          dR = c / 2 B, B = S N / fs                   `chirp`
    unambiguous range         fs c / 2 S; half of it for real samples      `chirp`
    range-Doppler coupling    dR_v = v f / S                               `chirp`
    Doppler frequency         f_D = 2 v / lambda                           `chirp`
    velocity resolution       dv = lambda / 2 M T                          `frame`
    unambiguous velocity      +-lambda / 4 T                               `frame`
    velocity ambiguity        v + n lambda / 2 T                           `velocity_ambiguity`
    virtual array             p = p_tx + p_rx                              `array`
    integration gain          N n_rx times the chirps of all transmitters  `radar`
    received power            Pt Gt Gr lambda^2 rcs / ((4 pi)^3 R^4 L)     `budget`
    noise power               k T0 F fs                                    `budget`
    Cramer-Rao bounds         range and velocity of one target             `estimation_bounds`
    waveform design           requirements to chirp and frame              `design`

S is the slope of the ramp, B the bandwidth swept while sampling, N the number of samples of a
chirp, fs the sample rate, M the number of chirps of a transmitter, T the time from one chirp of a
transmitter to its next, and lambda the wavelength at the middle of the sampling window. `Radar`
joins a `Frame` (with its `Chirp`), an `Array`, the `Hardware` and a `Calibration`.
"""
