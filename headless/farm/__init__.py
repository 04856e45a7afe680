"""The render farm: missing frames are split into chunks and rendered by many workers.

Only the output folder decides what is finished.
"""
