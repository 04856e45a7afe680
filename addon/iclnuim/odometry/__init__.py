"""Camera motion from colour and depth: odometers behind one protocol, and adapters to third-party ones."""
