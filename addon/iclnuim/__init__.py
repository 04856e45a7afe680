"""ICL-NUIM rebuilt: the library `import iclnuim`, and at the same time the Blender extension "ICL-NUIM Export".

Importing it loads neither Blender nor SciPy: every heavy import stands inside the function that needs it.
"""

__version__ = "0.1.0"
