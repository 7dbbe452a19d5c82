"""What is measured on a study: quantities, endpoints, trade-offs."""
