"""`python -m iclnuim_bench` is the command `iclnuim`."""

from .cli import command

command()
