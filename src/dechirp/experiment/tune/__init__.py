"""Settings that are searched for: the best of a stated aim, with what it is better by."""
