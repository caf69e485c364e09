"""Renderers on a GPU, with the bytes of the CPU: the extra `cuda`."""
