"""Poses, cameras, changes of axes and trajectories: arrays in, arrays out, numpy only."""
