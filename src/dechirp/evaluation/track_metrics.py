"""Metrics of tracks against the truth: GOSPA, OSPA, NEES and identity switches."""

from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.identity import track_identities
from dechirp.evaluation.nees import mean_nees_interval, nees
from dechirp.evaluation.ospa import ospa_m

__all__ = ["gospa", "mean_nees_interval", "nees", "ospa_m", "track_identities"]
