"""The goalie, after Delbruck and Lang, 2013. See docs/explanation/demos.md."""

TRACKERS = {"events": 0, "200 FPS": 200, "60 FPS": 60}
"""Name of a tracker -> frames per second; 0: events."""
