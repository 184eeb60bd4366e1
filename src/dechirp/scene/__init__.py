"""Scene: targets, bodies, their motion, and the truth about them."""
