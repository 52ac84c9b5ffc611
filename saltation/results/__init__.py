"""What a run leaves, and its files."""
