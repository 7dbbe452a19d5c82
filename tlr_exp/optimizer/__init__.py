"""The lower layer's weight optimizers: one file an algorithm, one protocol."""
