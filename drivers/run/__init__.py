"""From a TOML file to a finished run: settings, sinks, the run loop, its report."""
