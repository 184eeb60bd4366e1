"""The witness board on the files of the witnesses."""

import pytest

from dechirp.witnesses.base import Witness
from nightly import nightly


@nightly
@pytest.mark.parametrize("kind", Witness.members())
def test_witness_agrees_but_for_named_causes(kind, witness_data):
    witness = Witness.members()[kind]()
    try:
        comparisons = list(witness.compare(witness_data / witness.folder))
    except FileNotFoundError as error:
        pytest.skip(f"missing: {error}")

    assert comparisons
    unexplained = [item for item in comparisons if not (item.passed or item.cause)]
    assert unexplained == []
