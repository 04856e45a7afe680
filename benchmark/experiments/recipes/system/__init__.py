"""Third-party systems, run several times on sequences."""
