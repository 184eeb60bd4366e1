"""Settings files that come with recordings: what the radar sent, in the vendor's words."""
