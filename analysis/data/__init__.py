"""The runs of a study, found, checked and tabulated."""
