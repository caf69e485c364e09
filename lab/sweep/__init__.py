"""Sweep: measure the speed and the error of configurations around the presets."""
