"""Reading YAML files of other programs: cameras in EuRoC's, VSLAM-LAB's and OpenCV's form."""

import os
import re
from typing import Any

from ..errors import InputError, StrPath
from .files import read_text
from .libraries import first_library


def read_yaml(path: StrPath) -> dict[str, Any]:
    """Read a YAML mapping. All values are texts, lists and mappings.

    Raises InputError for other content.
    """
    _, yaml = first_library(os.fspath(path), "yaml")
    # OpenCV writes `%YAML:1.0`, which is not a directive of YAML
    text = re.sub(r"\A%YAML.*\n", "", read_text(path))
    try:
        content = yaml.load(text, yaml.BaseLoader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        found = getattr(error, "problem", None) or "other content"
        mark = getattr(error, "problem_mark", None)
        line = mark and mark.line + 1
        raise InputError("YAML", path=path, line=line, found=found) from None
    if not isinstance(content, dict):
        raise InputError("YAML with keys and values", path=path, found="other content")
    return content
