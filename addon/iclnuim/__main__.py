"""`python -m iclnuim` is the command `iclnuim`."""

import importlib
from contextlib import suppress
from types import ModuleType

from . import checkout
from .errors import WorkError


def load_command_line() -> ModuleType:
    """The module iclnuim.headless.cli, installed or from the checkout."""
    checkout.load("iclnuim.headless", "the command line")
    with suppress(WorkError):  # without it, the commands that need it say so
        checkout.load("iclnuim.benchmark", "the benchmark")
    return importlib.import_module("iclnuim.headless.cli")


if __name__ == "__main__":
    load_command_line().command()
