"""Light of the open scene: its light map, materials that show it, textures filtered for their
distance.
"""
