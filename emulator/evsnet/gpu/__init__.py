"""EvSNet on a GPU, with the bytes of the runtime `native`: the extra `cuda`."""
