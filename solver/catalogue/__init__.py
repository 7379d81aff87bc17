"""All effects that are known, discrepancy models and users' own among them."""
