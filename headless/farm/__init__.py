"""The farm: frames that are missing, split into chunks, rendered by many workers. What is done, the output folder alone says."""
