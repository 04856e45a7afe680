"""The formats of sequences, a module each: FORMAT is what the registry (sequence_formats.py) lists."""
