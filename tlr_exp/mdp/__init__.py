"""The Markov decision process: pure, batched functions, one per term."""
