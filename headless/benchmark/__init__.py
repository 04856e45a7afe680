"""Tables, charts, measurements: what the benchmark says, with the numbers it stands on."""
