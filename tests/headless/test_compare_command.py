"""`iclnuim compare`: recipes of which a part has another type are refused in one line with their
file.
"""

import numpy as np
import pytest
from iclnuim.formats.files import write_json
from iclnuim.formats.png import write_png


@pytest.mark.parametrize(
    ("name", "recipe", "message"),
    [
        ("recipe.json", {"source": []}, "expected a JSON object as source, found []"),
        ("recipe.json", {"source": {"run": 3}}, "expected a JSON object as run, found 3"),
        ("sequence.json", {"machine": None}, "expected a JSON object as machine, found null"),
        (
            "sequence.json",
            {"machine": {"features": None}},
            "expected a list as features, found null",
        ),
        (
            "sequence.json",
            {"machine": {"features": "avx"}},
            'expected a list as features, found "avx"',
        ),
    ],
)
def test_a_part_of_another_type_is_refused(name, recipe, message, tmp_path, command_here):
    write_json(tmp_path / name, recipe)
    code, _, error = command_here("compare", tmp_path, tmp_path)
    assert (code, error) == (2, f"iclnuim compare: {tmp_path / name}: {message}\n")


def test_images_that_come_from_no_run_are_compared(tmp_path, command_here):
    (tmp_path / "depth").mkdir()
    write_png(tmp_path / "depth/0.png", np.ones((480, 640), np.uint16))
    write_json(tmp_path / "recipe.json", {"source": {"images": "x"}})
    assert command_here("compare", tmp_path, tmp_path)[0] == 0
