"""The interface to Blender: all code that uses bpy, except the panel, is here.

Imports point one way: `render` -> `open` and `light` -> the modules of this folder. Modules import
bpy when they are imported, except output.py and child.py, the worker process.
"""
