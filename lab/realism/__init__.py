"""Is a stream of events realistic? (`evs realism`)."""
