"""One camera: what it is made from, its plan, its light, its pixels, its packets."""
