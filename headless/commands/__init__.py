"""One module a command: `configure(parser)` declares its options, `run(args, console)` does the
work and returns an exit code.
"""
