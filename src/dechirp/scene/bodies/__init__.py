"""Bodies of many scatterers, a family."""
