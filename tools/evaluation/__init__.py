"""Evaluation: event models on noisy light, laid beside the events of converged light."""
