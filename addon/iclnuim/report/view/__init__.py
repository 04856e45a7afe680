"""Results to look at in a browser: one HTML file with everything in it, that loads nothing."""
