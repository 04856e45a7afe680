"""`python -m iclnuim` is the command `iclnuim`."""

import importlib
from types import ModuleType

from . import checkout


def load_command_line() -> ModuleType:
    """The module iclnuim.headless.cli, installed or from the checkout."""
    checkout.load("iclnuim.headless", "the command line")
    return importlib.import_module("iclnuim.headless.cli")


if __name__ == "__main__":
    load_command_line().command()
