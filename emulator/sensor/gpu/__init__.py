"""The event pixel on a GPU, with the events of the CPU: the extra `cuda`."""
