"""Surfaces from depth: the truncated signed distance volume."""
