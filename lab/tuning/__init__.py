"""`evs tune`: the configuration of a scene that a goal of speed or of accuracy asks for."""
