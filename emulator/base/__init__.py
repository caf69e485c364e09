"""Shared by all stages: arrays, scenes, protocols between stages, features, memory."""
