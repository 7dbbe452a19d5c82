"""Motions of other projects: one module per file format; ``convert.import_motion`` reads any."""
