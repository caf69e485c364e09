"""One camera: its parts, its plan, its light, its pixels, its packets."""
