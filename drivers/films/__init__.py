"""Films and folders of frames into events. The only door to PyAV is decoder.py."""
