"""Runs systems that estimate camera motion, ours and third-party ones, measures their time, and
evaluates the trajectories that they wrote. A small TOML file describes each system.
"""
