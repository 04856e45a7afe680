"""Opening a scene: references to other files are checked, the file is imported, oriented and
repaired; checks of the open scene before rendering.
"""
