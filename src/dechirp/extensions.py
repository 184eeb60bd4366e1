"""Base classes of the families, and what their members need, for packages that add members."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(
    __name__,
    names_by_module={
        "dechirp.processing.cfar.base": "NoiseEstimator TrainingWindow",
        "dechirp.processing.cfar.window_means": "scaled_window_means",
        "dechirp.processing.angle.base": "DirectionEstimator SpectralEstimator",
        "dechirp.processing.mitigation.base": "Mitigation",
        "dechirp.simulation.impairments.base": "Oscillator Preset Propagation Receiver",
        "dechirp.recordings.readers.base": "Contents Format MatchQuality RecordingHints",
        "dechirp.recordings.writers.base": "Writer",
        "dechirp.recordings.description": "parse_radar",
        "dechirp.radar.multiplexing.base": "Multiplexing",
        "dechirp.radar.modulations.base": "Modulation",
        "dechirp.radar.patterns.base": "Pattern",
        "dechirp.radar.devices.base": "Device",
        "dechirp.scene.bodies.base": "AspectBody Body",
        "dechirp.evaluation.score.base": "Score",
        "dechirp.traffic.base": "ObjectState TrafficFormat",
        "dechirp.generators.base": "Design Generator",
        "dechirp.witnesses.base": "Comparison Witness compare_arrays",
        # Values with settings as fields
        "dechirp.core.values": "frozen_dataclass",
        "dechirp.core.checks": "check_non_negative_fields check_positive_fields",
    },
)
