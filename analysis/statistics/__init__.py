"""Statistics of a study: pure functions on arrays, one row or one number per seed."""
