"""A certificate in plain values: what `--json` prints, and all that the paper knows."""

from typing import Any

from dechirp.config.texts import plain
from dechirp.core.units import SPEED_OF_LIGHT, decibels
from dechirp.experiment.verify import every_detector, published, sensitivity
from dechirp.experiment.verify.certificate import Certificate
from dechirp.experiment.verify.checksum import of_code, of_numbers
from dechirp.experiment.verify.claim import CONFIDENCE, Check, Claim, Part
from dechirp.experiment.verify.estimates import bounds
from dechirp.experiment.verify.false_alarms import noise_tests
from dechirp.experiment.verify.looks import QUIET_SNR_DB, REFERENCE, at_mid_frame, radar
from dechirp.process.chain import Chain
from dechirp.theory.cfar_detection import cell_averaging_loss
from dechirp.theory.detection import required_snr


def document(certificate: Certificate) -> dict[str, Any]:
    """Everything about a certificate; the figures of a claim are those of its first check."""
    made = {
        "date": certificate.date,
        "seed": certificate.seed,
        "trials": certificate.trials,
        "full": certificate.full,
        "confidence": CONFIDENCE,
        "claims": [_claim(claim) for claim in certificate.claims],
        "parts": [_part(part) for part in certificate.parts],
        "passed": certificate.passed,
        "corrections": [plain(correction) for correction in certificate.corrections],
        "tables": [plain(table) for table in certificate.tables],
        "curves": [plain(curve) for curve in certificate.curves],
        "numbers": {
            **_numbers(),
            "measured_false_alarm_probabilities": sorted(
                {design.false_alarm_probability for design in noise_tests(full=certificate.full)},
                reverse=True,
            ),
        },
        "machine": certificate.machine,
        "versions": certificate.versions,
        "timing_s": certificate.timing_s,
        "code": of_code(),
    }
    return {**made, "checksum": of_numbers(made)}


def _part(part: Part) -> dict[str, Any]:
    return {
        "id": part.id,
        "title": part.title,
        "how": part.how,
        "claims": [_claim(claim) for claim in part.claims],
    }


def _claim(claim: Claim) -> dict[str, Any]:
    first, *_ = claim.checks
    return {
        "id": claim.id,
        "claim": claim.claim,
        "published": first.published,
        "required": _required(first),
        "measured": first.measured,
        "limit": first.limit,
        "passed": claim.passed,
        "unit": first.unit,
        "interval": None if first.low is None else [first.low, first.high],
        "trials": first.trials,
        "checks": [_check(check) for check in claim.checks],
        "note": claim.note,
    }


def _check(check: Check) -> dict[str, Any]:
    return {
        "name": check.name,
        "published": check.published,
        "required": _required(check),
        "measured": check.measured,
        "limit": check.limit,
        "passed": check.passed,
        "unit": check.unit,
        "interval": None if check.low is None else [check.low, check.high],
        "trials": check.trials,
    }


def _required(check: Check) -> dict[str, float] | None:
    """At least, at most, or both; None for what is measured for comparison alone."""
    ends = {"at_least": check.at_least, "at_most": check.at_most}
    return {name: end for name, end in ends.items() if end is not None} or None


def _numbers() -> dict[str, float]:
    """What the paper says of the radar, its detector and the reference target, SI and dB."""
    frame, chirp = radar().frame, radar().frame.chirp
    at = at_mid_frame(REFERENCE)
    cfar = Chain().cfar
    pfa = cfar.false_alarm_probability
    assert pfa is not None
    known = sensitivity.detector("rectangular")
    loss = cell_averaging_loss(sensitivity.DETECTION_PROBABILITY, pfa, n_training=known.n_training)
    delay_s = 2 * REFERENCE.range_m / SPEED_OF_LIGHT
    return {
        "start_frequency_hz": chirp.start_frequency_hz,
        "bandwidth_hz": chirp.sampled_bandwidth_hz,
        "chirp_duration_s": chirp.ramp_duration_s,
        "slope_hz_per_s": chirp.slope_hz_per_s,
        "sample_rate_hz": chirp.sample_rate_hz,
        "n_samples": chirp.n_samples,
        "n_chirps": frame.n_chirps,
        "frame_duration_s": frame.duration_s,
        "wavelength_m": chirp.wavelength_m,
        "range_bin_m": chirp.range_resolution_m,
        "velocity_bin_m_per_s": frame.velocity_resolution_m_per_s,
        "max_range_m": chirp.max_range_m,
        "max_velocity_m_per_s": frame.max_velocity_m_per_s,
        "integration_gain_db": float(decibels(radar().integration_gain)),
        "target_range_m": REFERENCE.range_m,
        "target_velocity_m_per_s": REFERENCE.velocity_m_per_s,
        "mid_frame_range_m": at.range_m,
        "delay_s": delay_s,
        "beat_frequency_hz": chirp.beat_frequency_hz(REFERENCE.range_m),
        "doppler_frequency_hz": 2 * REFERENCE.velocity_m_per_s / chirp.wavelength_m,
        "coupling_m": chirp.range_doppler_coupling_m(REFERENCE.velocity_m_per_s),
        "residual_video_phase_cycles": chirp.slope_hz_per_s * delay_s**2 / 2,
        "training_range": cfar.n_training.range,
        "training_velocity": cfar.n_training.velocity,
        "guard_range": cfar.n_guard.range,
        "guard_velocity": cfar.n_guard.velocity,
        "n_training": known.n_training,
        "false_alarm_probability": pfa,
        "detection_probability": sensitivity.DETECTION_PROBABILITY,
        "factor": known.factor,
        "factor_db": float(decibels(known.factor)),
        "cfar_loss_db": float(decibels(loss)),
        "needed_known_noise_db": float(
            decibels(required_snr(sensitivity.DETECTION_PROBABILITY, pfa))
        ),
        "needed_db": float(decibels(sensitivity.needed_in_map())),
        "report_offset_db": published.OFFSET_DB,
        "report_threshold_db": float(decibels(sensitivity.report_threshold())),
        "report_needed_db": float(decibels(sensitivity.needed_by_report())),
        "range_bound_m": bounds(published.LOWEST_SNR_DB).range_m,
        "velocity_bound_m_per_s": bounds(published.LOWEST_SNR_DB).velocity_m_per_s,
        "every_detector_false_alarm_probability": every_detector.PFA,
        "report_snr_db": published.LOWEST_SNR_DB,
        "quiet_snr_db": QUIET_SNR_DB,
    }
