"""The terms of an alignment (solver.Term): planes, grey values, depth and reprojections. Each makes
normal equations of the same form, so that methods combine them freely.
"""
