"""Long files: random access, sequential scans, and assembly of packets."""
