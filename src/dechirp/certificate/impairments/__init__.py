"""Measurements of every impairment against its formula.

Each measurement uses the public function `simulate`, with and without echoes. The formula is
written out beside the measurement; `weather_references` evaluates recommendations anew, or from
their tables.

    oscillators       phase noise, phase-locked loop, non-linear ramps, slope drift
    propagation       leakage, bumper, mutual coupling, position errors, road, wall, interference
    weather           attenuation by gas, rain and fog, rain backscatter, radome
    receiver_noise    thermal, white and coloured noise, aperture jitter, quantisation
    receivers         compression, I/Q imbalance, DC offset, IF filter, channel mismatch, a chip

`measurement` defines a measurement and turns its results into a claim, `reference_radar` holds the
radar and the functions that read its samples. A new impairment needs one more measurement in one of
these files.
"""
