"""Reading of JSON: what is not a JSON object of finite numbers is refused in one line."""

import pytest
from iclnuim.errors import InputError
from iclnuim.formats.files import content_of_json, read_json


@pytest.mark.parametrize(
    ("value", "found"),
    [
        ("9" * 5000, "a number of 5000 digits"),
        ("9" * 400, "a number of 400 digits"),
        *((word, f"the number {word}") for word in ("NaN", "Infinity", "-Infinity", "1e999")),
        ("[" * 100_000, "brackets nested too deeply"),
        ("x", "other text"),
    ],
)
def test_a_value_that_is_no_finite_number_is_refused_with_the_file(value, found, tmp_path):
    path = tmp_path / "camera.json"
    path.write_text(f'{{"width": {value}}}')
    with pytest.raises(InputError, match=rf"camera\.json(:1)?: expected JSON, found {found}"):
        read_json(path)


def test_a_large_number_is_read():
    assert content_of_json(f"[{2**64}, 1e300, -1]") == [2**64, 1e300, -1]
