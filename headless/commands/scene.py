"""`iclnuim scene`: builds a shipped scene from code, or compares it with the official frames.

Needs a checkout: tools/scene_command.py.
"""

import importlib
from argparse import ArgumentParser

from iclnuim import checkout


def configure(parser: ArgumentParser) -> None:
    checkout.load("iclnuim.tools", "building or comparing a scene")
    checkout.load("iclnuim.blend.builder", "building or comparing a scene")
    importlib.import_module("iclnuim.tools.scene_command").configure(parser)
