"""Radar chips on boards: antenna positions, limits, and settings files."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(
    __name__,
    "dechirp.radar.devices",
    names_by_module={
        "dechirp.recordings.settings.write_ti_cfg": "format_ti_cfg",
    },
)
