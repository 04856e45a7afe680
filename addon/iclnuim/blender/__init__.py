"""The interface to Blender: all code that uses bpy, except the panel, is here. Modules import bpy
when they are imported, except output.py and
child.py.
"""
