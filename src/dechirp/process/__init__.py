"""From samples to detections; knows neither the scene nor the simulator."""
