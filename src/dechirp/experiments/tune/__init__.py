"""Search for the settings that maximise or minimise a score within limits."""
