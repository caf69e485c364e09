"""Laws of the pixel in NumPy, byte for byte those of core/sensor."""
