"""Traffic of other simulators and of recorded roads: the true motion of all objects over time."""
