"""One module per format: what each project calls its arrays, and how it means them."""
