"""The only room that talks to Blender: bpy in, plain values out, no maths. Nothing here imports bpy before it is called."""
