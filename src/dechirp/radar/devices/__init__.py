"""Known radar chips and boards: where their antennas are, and what they allow."""
