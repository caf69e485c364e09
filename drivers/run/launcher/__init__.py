"""Run several programs from one file: start them in order, watch them, stop them in order."""
