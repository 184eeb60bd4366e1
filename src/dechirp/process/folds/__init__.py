"""Which fold a velocity is in: told by transmitters, ramps, other intervals, or triangles."""
