"""Cable stage: how the fiber lies and how it follows the ground."""
