"""Certificate as a document of plain values, for JSON output and the paper.

Two runs with the same seed are compared by one line: the SHA-256 of the numbers. They are rounded
to six digits, because processors differ in the last of sixteen. Sentences and labels do not
enter, so that a certificate can be reworded; ids and units do.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

from dechirp.certificate import every_detector, published, sensitivity
from dechirp.certificate.certificate import Certificate
from dechirp.certificate.claim import CONFIDENCE, Check, Claim, Part
from dechirp.certificate.estimates import range_velocity_cramer_rao_bounds
from dechirp.certificate.false_alarms import planned_noise_tests
from dechirp.certificate.reference_trials import (
    QUIET_SNR_DB,
    REFERENCE_TARGET,
    motion_at_mid_frame,
    reference_radar,
)
from dechirp.config.dumping import to_json_data
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.processing.chain import Chain
from dechirp.theory.cfar_detection import cell_averaging_loss
from dechirp.theory.detection import required_snr

PROVENANCE_KEYS = frozenset(
    ("checksum", "code", "date", "files", "machine", "timing_s", "version", "versions")
)
"""Keys that describe the date, the machine and the software of a run instead of its results."""
TEXT_KEYS = frozenset(("id", "unit"))
"""Keys whose text enters the checksum."""
_DIGITS = 6


def checksum_of_numbers(document: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the numbers of a certificate, in hexadecimal.

    The digest is that of canonical JSON: sorted keys, no spaces, six digits, no text except ids and
    units.

    Parameters
    ----------
    document : mapping
        Result of `certificate_as_json_data`, or the content of `verify.json`.
    """
    results = {key: content for key, content in document.items() if key not in PROVENANCE_KEYS}
    return _sha256_of_rounded_json(_drop_texts_except_ids_and_units(results))


def _sha256_of_rounded_json(content: object) -> str:
    """Return the SHA-256 of canonical JSON with rounded numbers."""
    text = json.dumps(
        _numbers_as_six_digit_text(content),
        sort_keys=True,
        separators=(",", ":"),
        ensure_ascii=True,
        allow_nan=False,
    )
    return hashlib.sha256(text.encode()).hexdigest()


def _drop_texts_except_ids_and_units(content: object) -> object:
    """Drop all texts but ids and units."""
    if isinstance(content, Mapping):
        return {
            key: _drop_texts_except_ids_and_units(child)
            for key, child in content.items()
            if key in TEXT_KEYS or not isinstance(child, str)
        }
    if isinstance(content, list | tuple):
        return [
            _drop_texts_except_ids_and_units(child)
            for child in content
            if not isinstance(child, str)
        ]
    return content


def package_code_checksum() -> str:
    """Return the SHA-256 of all Python files of the package, in hexadecimal."""
    digest = hashlib.sha256()
    for name, content in sorted(_python_file_paths_and_contents(files("dechirp"), "dechirp")):
        digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()


def _python_file_paths_and_contents(
    folder: Traversable, folder_path: str
) -> list[tuple[str, bytes]]:
    files_with_content = []
    for entry in folder.iterdir():
        path = f"{folder_path}/{entry.name}"
        if entry.is_dir():
            files_with_content += _python_file_paths_and_contents(entry, path)
        elif entry.name.endswith(".py"):
            # Git may have converted the line endings.
            files_with_content.append((path, entry.read_bytes().replace(b"\r\n", b"\n")))
    return files_with_content


def _numbers_as_six_digit_text(content: object) -> object:
    if isinstance(content, Mapping):
        return {name: _numbers_as_six_digit_text(inside) for name, inside in content.items()}
    if isinstance(content, list | tuple):
        return [_numbers_as_six_digit_text(inside) for inside in content]
    if isinstance(content, bool | str) or content is None:
        return content
    if isinstance(content, int | float):  # 1 and 1.0 are one number
        return f"{content:.{_DIGITS}g}" if math.isfinite(content) else None
    raise TypeError(f"not a JSON value: {content!r}")


def certificate_as_json_data(certificate: Certificate) -> dict[str, Any]:
    """Convert a certificate to plain values; the values of a claim are those of its first check."""
    fields = {
        "date": certificate.date,
        "seed": certificate.seed,
        "trials": certificate.trials,
        "full": certificate.full,
        "confidence": CONFIDENCE,
        "claims": [_claim_as_json_data(claim) for claim in certificate.claims],
        "parts": [_part_as_json_data(part) for part in certificate.parts],
        "passed": certificate.passed,
        "corrections": [to_json_data(correction) for correction in certificate.corrections],
        "tables": [to_json_data(table) for table in certificate.tables],
        "curves": [to_json_data(curve) for curve in certificate.curves],
        "numbers": {
            **_radar_and_detector_numbers_of_paper(),
            "measured_false_alarm_probabilities": sorted(
                {
                    design.false_alarm_probability
                    for design in planned_noise_tests(full=certificate.full)
                },
                reverse=True,
            ),
        },
        "machine": certificate.machine,
        "versions": certificate.versions,
        "timing_s": certificate.timing_s,
        "code": package_code_checksum(),
    }
    return {**fields, "checksum": checksum_of_numbers(fields)}


def _part_as_json_data(part: Part) -> dict[str, Any]:
    return {
        "id": part.id,
        "title": part.title,
        "method": part.method,
        "claims": [_claim_as_json_data(claim) for claim in part.claims],
    }


def _claim_as_json_data(claim: Claim) -> dict[str, Any]:
    first, *_ = claim.checks
    return {
        "id": claim.id,
        "claim": claim.claim,
        "published": first.published,
        "required": _requirement_as_json_data(first),
        "measured": first.measured,
        "limit": first.limit,
        "passed": claim.passed,
        "unit": first.unit,
        "interval": None if first.low is None else [first.low, first.high],
        "trials": first.trials,
        "checks": [_check_as_json_data(check) for check in claim.checks],
        "note": claim.note,
    }


def _check_as_json_data(check: Check) -> dict[str, Any]:
    return {
        "name": check.name,
        "published": check.published,
        "required": _requirement_as_json_data(check),
        "measured": check.measured,
        "limit": check.limit,
        "passed": check.passed,
        "unit": check.unit,
        "interval": None if check.low is None else [check.low, check.high],
        "trials": check.trials,
    }


def _requirement_as_json_data(check: Check) -> dict[str, float] | None:
    """Return the lower and upper requirement; None if a check serves only for comparison."""
    bounds = {"at_least": check.at_least, "at_most": check.at_most}
    return {name: bound for name, bound in bounds.items() if bound is not None} or None


def _radar_and_detector_numbers_of_paper() -> dict[str, float]:
    """Return the numbers of the paper about radar, detector and reference target, SI and dB."""
    frame, chirp = reference_radar().frame, reference_radar().frame.chirp
    target = motion_at_mid_frame(REFERENCE_TARGET)
    cfar = Chain().cfar
    pfa = cfar.false_alarm_probability
    assert pfa is not None
    detector_law = sensitivity.chain_detector_law("rectangular")
    loss = cell_averaging_loss(
        sensitivity.DETECTION_PROBABILITY, pfa, n_training=detector_law.n_training
    )
    delay_s = 2 * REFERENCE_TARGET.range_m / SPEED_OF_LIGHT
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
        "integration_gain_db": float(to_decibels(reference_radar().integration_gain)),
        "target_range_m": REFERENCE_TARGET.range_m,
        "target_velocity_m_per_s": REFERENCE_TARGET.velocity_m_per_s,
        "mid_frame_range_m": target.range_m,
        "delay_s": delay_s,
        "beat_frequency_hz": chirp.beat_frequency_hz(REFERENCE_TARGET.range_m),
        "doppler_frequency_hz": 2 * REFERENCE_TARGET.velocity_m_per_s / chirp.wavelength_m,
        "coupling_m": chirp.range_doppler_coupling_m(REFERENCE_TARGET.velocity_m_per_s),
        "residual_video_phase_cycles": chirp.slope_hz_per_s * delay_s**2 / 2,
        "training_range": cfar.n_training.range,
        "training_velocity": cfar.n_training.velocity,
        "guard_range": cfar.n_guard.range,
        "guard_velocity": cfar.n_guard.velocity,
        "n_training": detector_law.n_training,
        "false_alarm_probability": pfa,
        "detection_probability": sensitivity.DETECTION_PROBABILITY,
        "factor": detector_law.factor,
        "factor_db": float(to_decibels(detector_law.factor)),
        "cfar_loss_db": float(to_decibels(loss)),
        "needed_known_noise_db": float(
            to_decibels(required_snr(sensitivity.DETECTION_PROBABILITY, pfa))
        ),
        "needed_db": float(to_decibels(sensitivity.chain_required_snr())),
        "report_offset_db": published.OFFSET_DB,
        "report_threshold_db": float(to_decibels(sensitivity.report_threshold())),
        "report_needed_db": float(to_decibels(sensitivity.report_rule_required_snr())),
        "range_bound_m": range_velocity_cramer_rao_bounds(published.LOWEST_SNR_DB).range_m,
        "velocity_bound_m_per_s": range_velocity_cramer_rao_bounds(
            published.LOWEST_SNR_DB
        ).velocity_m_per_s,
        "every_detector_false_alarm_probability": every_detector.FALSE_ALARM_PROBABILITY,
        "report_snr_db": published.LOWEST_SNR_DB,
        "quiet_snr_db": QUIET_SNR_DB,
    }
