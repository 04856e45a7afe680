"""Measurements of the project itself, from a checkout: not part of the wheel or of the extension."""
