"""Resolution of the velocity ambiguity by transmitters, ramps, triangles or other intervals."""
