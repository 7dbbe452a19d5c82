"""The environment: physics, motion and pure functions of the instant; it knows no weights."""
