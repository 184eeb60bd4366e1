"""Foundation that all other packages share: values, checks, errors, units and text."""
