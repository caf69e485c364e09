"""Turn films and folders of frames into events. Only decoder.py imports PyAV."""
