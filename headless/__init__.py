"""All of ICL-NUIM that runs without a window: the command `iclnuim`, the farm, odometers, tables and charts."""
