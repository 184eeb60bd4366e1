"""What looks wrong with samples: measured frame by frame, judged over a whole recording."""
