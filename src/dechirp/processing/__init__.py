r"""Processing of FMCW samples: from the samples of a frame to its detections.

`frame.process_frame` runs the steps below, `detect.detect` over the frames of a cube; `chain.Chain`
holds their settings. Nothing here depends on the scene or the simulator. Beat signal of a target
at range R with radial velocity v in chirp m, sample n, slot l (one transmitter or ramp of a round):

    x[m, l, n] = a_l exp j (2 pi f_b n / f_s + 2 pi f_D (m T + t_l)),
    f_b = S tau + f_D,   tau = 2 R / c,   f_D = 2 v / lambda

1. `mitigation/`: repairs interference, filters slow time, subtracts leakage.
2. `virtual_array.split_chirps_into_slots`: channels of the slots of each round, channel =
   (l, receiver).
3. `spectrum.mean_range_doppler_power`, `range_doppler_map`: windows w_m, w_n and two discrete
   Fourier transforms, averaged over K channels,
   P[k, i] = 1 / K sum |sum w_m w_n x[m, l, n] exp -2 pi j (k m / M + i n / N)|^2 / (sum w)^2;
   `range_walk` keeps targets that cross range cells in one.
4. `cfar/`: a cell is over threshold where P > alpha Z, Z the noise estimate of its training cells;
   `peaks`: local maxima over threshold that no sidelobe explains.
5. `peak_interpolation`, then `refine`: frequencies (f_b, f_D) at the maximum of the unwindowed
   periodogram, summed over channels, other tones subtracted (RELAX). `sidelobe_rejection`: peaks
   beside echoes that tones do not describe are estimated again, `windowed_tones`.
   `estimates`: SNR; R = c (f_b - f_D) / 2 S, v = lambda f_D / 2, standard errors at the
   Cramer-Rao bound.
6. `velocity_ambiguity/`: number h of spans, f_D = f_principal + h / T, by the phases
   2 pi f_D t_l between slots, by the two beats of triangles, or by frames with other intervals.
7. `direction_finding`, `angle/`: phases between slots compensated, transmitters decoded,
   a_k = a exp 2 pi j u . p_k / lambda over the elements p_k; direction u of each source.
8. `frame.build_detection_columns`: rows of `core.detection_columns`, referred to the origin.

`cluster` groups detections into objects (`centroids` averages them). Beside the chain:
`angle_maps` (power over azimuth and range), `spectrogram` and `slow_time` (micro-Doppler,
displacement), `calibration/`, `quality/` (checks of recordings), `fixed_point/` (word lengths).
`simd_*.py` are hand-vectorised twins of plain functions, which their first lines name.
"""
