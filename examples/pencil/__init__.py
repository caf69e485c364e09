"""The pencil balancer, after Conradt et al., ISCAS 2009. See docs/explanation/demos.md."""

TRACKERS = {"events": 0, "1000 FPS": 1000, "100 FPS": 100, "60 FPS": 60, "30 FPS": 30}
"""Name of a tracker -> frames per second; 0: events."""
