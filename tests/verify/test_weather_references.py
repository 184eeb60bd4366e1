"""Weather checks of the certificate: references that a fault of the package does not follow."""

import numpy as np
import pytest

from dechirp.certificate.impairments.weather import MEASUREMENTS
from dechirp.theory import attenuation, water_permittivity


@pytest.fixture
def evaluate():
    """Return a function that evaluates the claim on one kind of impairment."""

    def evaluate_claim(kind):
        (measurement,) = (m for m in MEASUREMENTS if m.kind == kind)
        results = np.array([measurement.measure(np.random.default_rng(0))])
        return measurement.evaluate_claim({measurement.job_name: results})

    return evaluate_claim


FAULTS = {
    "gas-attenuation": (attenuation, "OXYGEN", attenuation.OXYGEN * [1, 1.02, 1, 1, 1, 1]),
    "rain-attenuation": (attenuation, "_K_H", (*attenuation._K_H[:2], 0.715)),
    "fog-attenuation": (attenuation, "water_relative_permittivity", lambda f, t: 7.2 + 13j),
    "radome": (water_permittivity, "water_relative_permittivity", lambda f, t: 7.2 + 13j),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_fault_of_a_weather_function_fails_its_claim(kind, evaluate, monkeypatch):
    assert evaluate(kind).passed

    monkeypatch.setattr(*FAULTS[kind])

    assert not evaluate(kind).passed
