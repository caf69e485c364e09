"""Programs around the emulator: data sets, jobs, controller tests, doctor."""
