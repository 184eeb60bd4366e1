"""Certificate: claims of the reference report and of the package, measured against theory.

`certificate.verify` collects the trial jobs of the claim modules, runs them with
`trials.run_jobs`, and passes the results to `evaluate_claims` of the same modules. `document`
converts the certificate to plain values, from which `paper` and `paper_figures` make the paper.

    waveform        chirp_linearity beat_frequency_50m echo_power_50m
    transforms      integration_gain blind_doppler
    estimates       range_stationary_100m range_doppler_peak corner_200m_100mps
                    direction_of_motion range_rmse velocity_rmse
    detection       detection_at_minus24db snr_limit
    false_alarms    false_alarms_minus10db false_alarm_rate
    resolution      two_targets_resolved

A full certificate adds the parts of `extended`:

    every_detector  false alarms of every detector with every window
    directions      errors and resolution of every direction estimator
    impairments     measurements of every impairment against its formula

Shared modules:

    reference_trials    reference radar and target, and trials of the chain in noise
    shared_trials       trials of the reference target that several claims share
    sensitivity         theoretical detection curves and SNR limits
    published           published values of the report, and its detection rule
    checksum            checksum by which two certificates are compared
"""
