"""Raw samples: word order, order of I and Q, and division into frames."""
