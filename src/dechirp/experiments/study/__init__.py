"""Studies: trials over varied settings, kept as they come, and judged. `run` calls the rest."""
