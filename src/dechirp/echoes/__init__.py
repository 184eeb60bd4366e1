"""What the converter samples."""
