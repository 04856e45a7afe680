"""Predicted depth against the depth of a sequence: reading, groups, errors, pictures."""
