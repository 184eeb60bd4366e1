"""What is known without a radar: detection, false alarms, bounds, windows."""
