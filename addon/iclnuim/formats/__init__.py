"""Readers and writers of files: trajectories of all formats, EXR, PNG, PLY, JSON.

The name of each conversion states its frames.
"""
