"""The version of iclnuim: of the library, the extension and the commands."""

__version__ = "0.2.0"
