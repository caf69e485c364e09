"""Kernels on an NVIDIA GPU: its driver, and the compiler of the native core's kernels (`cuda`)."""
