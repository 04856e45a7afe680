"""The sequences with labels, as the tests of sequences have them."""

from sequences.conftest import all_formats, labelled_formats, labelled_run, shared_run

__all__ = ["all_formats", "labelled_formats", "labelled_run", "shared_run"]
