"""`evs tune`: find the configuration that reaches a goal of speed or accuracy for a scene."""
