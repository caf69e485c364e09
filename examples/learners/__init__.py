"""Data for learners from other libraries, which docs/howto/learners.md trains."""
