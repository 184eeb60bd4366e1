"""The reference report, claim by claim: published, required, measured, and what theory allows."""
