"""Events in MuJoCo Studio, the viewer of MuJoCo 4: event_window.py is a plugin for it."""
