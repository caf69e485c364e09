"""What every stage shares: arrays, scenes, protocols between stages, features, memory."""
