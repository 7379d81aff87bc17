"""What the paper publishes: its network, circles and regularizers."""
