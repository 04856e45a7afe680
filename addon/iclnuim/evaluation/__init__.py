"""Trajectory error: association, alignment, absolute and relative error; and image error.

Functions of arrays with frozen results, numpy only.
"""
