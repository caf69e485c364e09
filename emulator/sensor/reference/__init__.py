"""Laws of the pixel in NumPy, with the same bytes as core/sensor."""
