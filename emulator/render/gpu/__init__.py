"""The renderers `direct` and `path` on a GPU, with the bytes of the CPU: the extra `cuda`."""
