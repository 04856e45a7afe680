"""Everything that runs without a window: the command `iclnuim`, the render farm, the benchmark, tables and charts."""
