"""Connections to the outside: pipelines, the run loop, bus, files. Import from the subpackages."""
