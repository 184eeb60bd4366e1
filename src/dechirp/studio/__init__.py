"""The web page: a radar that one can turn the knobs of."""
