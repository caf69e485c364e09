"""What a scene requires: the code paths that run, why, and what they cost (scene_plan)."""
