"""Three closed loops with event cameras to read, run (`evs loop`) and copy.

cartpole is the shortest, goalie and pencil compare events with frames. Each folder has
environment.py (the scene, its starts and pushes), tracker code (events to a state), controller.py
(observations to controls) and gif.py (a film of it). common has the shared code. studio is a
plugin for the viewer of MuJoCo 4.
"""
