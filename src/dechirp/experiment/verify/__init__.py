"""The reference report, claim by claim: published, required, measured, and what theory allows.

`certificate.verify` gathers the `jobs` of every file of claims, lets `trials.run_all` run them,
and hands the arrays to the `claims` of the same files, which judge. `document` writes all of
it down; the paper is made from that.

    waveform        chirp_linearity beat_frequency_50m echo_power_50m
    transforms      integration_gain blind_doppler
    estimates       range_stationary_100m range_doppler_peak corner_200m_100mps
                    direction_of_motion range_rmse velocity_rmse
    detection       detection_at_minus24db snr_limit
    false_alarms    false_alarms_minus10db false_alarm_rate
    resolution      two_targets_resolved

In full `further` adds parts beyond the report:

    every_detector  false alarms of every detector under every window
    directions      errors and resolution of every direction estimator
    impaired        every impairment against its formula; measurements are in `impairments`

`looks` has the radar, the reference target and what the chain makes of it, `reference_target`
the trials that several claims share, `sensitivity` the curves of theory, `published` what the
report says and its detector, `checksum` what one compares two certificates by.
"""
