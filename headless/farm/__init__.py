"""The farm: frames that are missing, split into chunks, rendered by many workers. Only the output folder decides what is done."""
