"""Long files: read in parts, looked through, put together from packets."""
