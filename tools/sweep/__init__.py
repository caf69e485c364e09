"""The trade of speed for accuracy, measured: points, their cost, their error."""
