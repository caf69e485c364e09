"""Several programs from one file: read, started in order, watched, stopped in order."""
