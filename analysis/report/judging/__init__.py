"""The paper's claims, and what a study can say to each."""
