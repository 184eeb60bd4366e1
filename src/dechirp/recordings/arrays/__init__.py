"""Arrays in files, read in parts, and their interpretation as cubes by named axes."""
