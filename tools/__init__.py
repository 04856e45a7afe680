"""Measurements of the project itself.

They need a checkout, and are not part of the wheel or the extension.
"""
