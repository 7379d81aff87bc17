"""The six stages in one chain, their parameters, and their derivatives."""
