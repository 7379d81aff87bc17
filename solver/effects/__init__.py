"""Effects that the base model lacks: the catalogue, and users' own."""
