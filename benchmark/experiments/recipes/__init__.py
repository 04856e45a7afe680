"""The experiments, a folder each. One that is a class derived from `Experiment` is found here by
its name, and runs as `iclnuim experiment NAME`; the others have commands of their own.
"""

from importlib import import_module
from pkgutil import iter_modules

from ..experiment import Experiment, experiment_in


def experiments() -> dict[str, type[Experiment]]:
    """Name -> the experiment of each folder that has one."""
    found = {}
    for name in sorted(module.name for module in iter_modules(__path__)):
        if experiment := experiment_in(import_module(f"{__name__}.{name}")):
            found[name] = experiment
    return found
