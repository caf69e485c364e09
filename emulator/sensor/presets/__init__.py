"""Sensor files: what a real chip is told by, and its biases."""
