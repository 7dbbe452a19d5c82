"""Measures of a study: quantities, endpoints, trade-offs."""
