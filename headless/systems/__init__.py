"""Systems that estimate camera motion, ours and other people's, each a small TOML file; run, timed, and judged by what they wrote."""
