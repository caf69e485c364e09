"""Keep a goal with a fast paddle, after Delbruck and Lang, 2013.

A camera looks down on the table. A cluster of events follows the ball, a straight path is fitted
through it (tracker.py), and the paddle moves to where the path crosses the goal line
(controller.py). environment.py shoots the balls; speed_curve.py measures how many are saved over
their speed, with events and with frames. Start in environment.py: GoalieExperiment.shoot.

Results: docs/explanation/demos.md.
"""

TRACKERS = {"events": 0, "200 FPS": 200, "60 FPS": 60}
"""name of a tracker -> frames per second; 0: events"""
