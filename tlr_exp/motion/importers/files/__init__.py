"""Kinds of file, taken apart into arrays: archives, pickles read as data, tables of text."""
