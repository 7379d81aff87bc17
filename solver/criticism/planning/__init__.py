"""A survey judged before it is driven: expected sigmas, effects that it could see, what to add."""
