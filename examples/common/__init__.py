"""What the examples share: sensors, pushes, a search, a file of results, GIFs."""
