"""Evaluation: event models on noisy light, compared with the events of converged light."""
