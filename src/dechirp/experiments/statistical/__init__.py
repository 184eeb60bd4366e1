"""Statistical sensor: draws detections from theory, without samples."""
