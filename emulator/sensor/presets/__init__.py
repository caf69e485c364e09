"""Sensor files: the parameters of a real chip, and its biases."""
