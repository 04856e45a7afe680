"""What was started in a folder, so that nothing else is mixed with it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..formats.files import read_json


@dataclass(frozen=True)
class Record:
    """The work that is to be started or resumed, and the JSON file that says what was started.

    identity: the values that may not differ. described: texts for messages, by key, instead of
    values that differ.
    """

    kind: str
    file: Path
    identity: Mapping[str, Any]
    described: Mapping[str, str] = field(default_factory=dict)
    hint: str = "another {out}"

    def is_begun(self) -> bool:
        """Whether the file exists. Raises InputError if it has other values of the identity."""
        if not self.file.is_file():
            return False
        content = read_json(self.file)
        self.refuse_other({key: content.get(key) for key in self.identity})
        return True

    def refuse_other(self, there: Mapping[str, Any]) -> None:
        """Raises InputError if the work was started with other values, `there`. The message lists
        every value that differs.
        """
        different = []
        for key in sorted({*there, *self.identity}):
            begun = there.get(key)
            requested = self.identity.get(key)
            if begun != requested:
                different.append(self.described.get(key) or _difference(key, begun, requested))
        if different:
            expected = f"the {self.kind} that was started there"
            raise InputError(expected, path=self.file, found="; ".join(different), hint=self.hint)


def _difference(key: str, there: Any, requested: Any) -> str:
    text = f"{key} {there} there, {requested} requested"
    if len(text) < 100 and not key.endswith("_sha256"):
        return text
    return f"another {key.removesuffix('_sha256')}"
