"""Shared by the examples: a base class of environments, searches, result files, GIFs."""
