"""From rendered frames to sequences: the folder of a run, noise, formats, inspection."""
