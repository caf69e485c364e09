"""Data for learners that other people wrote: docs/howto/learners.md trains them."""
