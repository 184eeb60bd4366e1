"""Recording quality: measures of frames, and findings on receivers, samples and interference."""
