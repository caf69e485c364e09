"""Pole balancing on gymnasium's inverted pendulum, from its cart. See docs/explanation/demos.md."""

TRACKERS = {"events": 0}
"""Name of a tracker -> frames per second; 0: events."""

SEEDS = 20
"""How many starts a measurement takes."""
