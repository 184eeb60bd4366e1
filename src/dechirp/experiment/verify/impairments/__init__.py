"""Claims on impairments: each member of the family measured against its formula.

Measured through `simulate`, as users have it, on echoes and in silence; the formula is written
out anew beside each measurement, or is that of `theory` where a recommendation has many terms.

    oscillators     phase noise, loop, curved and rippled ramps, drift
    ways            leakage, bumper, coupling, antennas out of place, road, wall, other radars
    weather         gas, rain, fog, drops, radome
    noises          thermal, white, coloured, jitter, quantisation
    receivers       compression, image, offset, filter, mismatch, a chip

`measurement` says what a measurement is and makes claims of its results, `bench` has the radar
and what reads its samples. Adding a member to the family asks for one more measurement, in one
of these files.
"""
