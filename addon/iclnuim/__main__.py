"""`python -m iclnuim` is the command `iclnuim`."""

from types import ModuleType


def load_command_line() -> ModuleType:
    """The module iclnuim.headless.cli, installed or from the checkout."""
    import importlib

    from . import checkout

    checkout.load("iclnuim.headless", "the command line")
    return importlib.import_module("iclnuim.headless.cli")


if __name__ == "__main__":
    load_command_line().command()
