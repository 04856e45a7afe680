"""The files that a scene of any format names, found before Blender opens it, without bpy: for the
list of the kernel's wall, for refusals in words, and for the scene's hash.
"""
