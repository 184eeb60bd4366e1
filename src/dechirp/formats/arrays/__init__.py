"""Arrays whose axes the user names: what their containers share."""
