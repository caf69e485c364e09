"""Simulations: evs's own loop, a camera in the user's loop, and closed loops."""
