"""The sequence formats, one module each.

FORMAT is the entry of the registry (sequence_formats.py).
"""
