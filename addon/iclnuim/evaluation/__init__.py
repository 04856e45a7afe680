"""Trajectory error: association, alignment, absolute and relative error. Arrays in, frozen results out, numpy only."""
