"""Closed loops that show why: examples to copy, and what they share to be compared fairly."""
