"""The only room that talks to Blender: bpy in, plain values out, no maths. Its modules import bpy when they are imported, except output.py and child.py."""
