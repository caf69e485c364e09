"""Worlds that run: our own loop, a camera in a loop of the user, and closed loops."""
