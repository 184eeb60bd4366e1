"""Fixed-point processing up to the detector, bit-accurate for given word lengths."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(
    __name__,
    "dechirp.processing.fixed_point",
    names_by_module={
        "dechirp.results.hex_vectors": "read_vectors write_vectors",
        "dechirp.generators.c": "write_c",
        "dechirp.simulation.adc_codes": "extract_adc_codes",
    },
)
