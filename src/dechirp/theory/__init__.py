"""What is known without a radar: detection, CFAR, bounds on estimates, intervals, windows."""
