"""The radar, and what follows from it."""
