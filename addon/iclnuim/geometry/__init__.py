"""Poses, cameras, changes of axes and trajectories: functions of arrays, numpy only."""
