"""Balance a pencil on its tip with two event cameras, after Conradt et al., ISCAS 2009.

In each camera a line follows the events of the pencil (line_tracker.py). Two lines give tilt and
position (stereo.py), an observer predicts over the delay, and state feedback moves the cart
(balance.py); controller.py joins them. environment.py builds the scene and runs trials; study.py
tunes every tracker by the same search and finds its limits. Start in environment.py:
PencilExperiment.play.

Results: docs/explanation/demos.md.
"""

TRACKERS = {"events": 0, "1000 FPS": 1000, "100 FPS": 100, "60 FPS": 60, "30 FPS": 30}
"""name of a tracker -> frames per second; 0: events"""
