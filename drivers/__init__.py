"""Where the emulator meets the outside: pipelines, the run loop, bus, files. Import from inside."""
