"""How an antenna sees directions: a family."""
