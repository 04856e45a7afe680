"""What is only a file: EXR, PNG, PLY, OBJ, STL, JSON, bags.

Names of functions state frames and units.
"""
