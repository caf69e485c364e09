"""What the examples share: their environments' base, searches, a file of results, GIFs."""
