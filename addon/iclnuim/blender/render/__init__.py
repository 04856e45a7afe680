"""Rendering of the open scene: settings, camera, frames, ground truth, and the session that renders
a run.
"""
