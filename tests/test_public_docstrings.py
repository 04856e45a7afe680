"""Every public function, class, method and property that takes or gives an array says its shape."""

import inspect
import re
from collections.abc import Iterator

import iclnuim
import numpy as np
import pytest

_SIDE = r"(?:\d+|\.\.\.|[a-z]\w*)(?: ?[+-] ?[\w]+)?"
SHAPE = re.compile(rf"\({_SIDE},(?: ?{_SIDE},?)*\)|\(\.\.\.\)|any shape")
#: Types of arguments that may be arrays.
ARRAYS = ("ndarray", "Poses")


def arrays_of(annotations: dict) -> list[str]:
    """The names whose annotation has an array."""
    found = []
    for name, annotation in annotations.items():
        text = annotation if isinstance(annotation, str) else repr(annotation)
        if any(array in text for array in ARRAYS):
            found.append(name)
    return found


def functions_of(group: type) -> Iterator[tuple[str, object]]:
    for name, member in vars(group).items():
        member = getattr(member, "__func__", getattr(member, "fget", member))
        member = getattr(member, "func", member)  # of a cached_property
        if not name.startswith("_") and inspect.isfunction(member):
            yield name, member


def complaints(name: str, public: object) -> Iterator[str]:
    if inspect.isfunction(public):
        if arrays_of(public.__annotations__) and not SHAPE.search(public.__doc__ or ""):
            yield f"{name} has no shape of {arrays_of(public.__annotations__)}"
    elif inspect.isclass(public):
        doc = public.__doc__ or ""
        fields = arrays_of(vars(public).get("__annotations__", {}))
        if fields and not SHAPE.search(doc):
            yield f"{name} has no shape of {fields}"
        yield from (f"{name} does not name {field}" for field in fields if field not in doc)
        for method, function in functions_of(public):
            yield from complaints(f"{name}.{method}", function)


@pytest.mark.parametrize("name", iclnuim.__all__)
def test_every_array_of_a_public_name_has_a_shape(name):
    assert list(complaints(name, getattr(iclnuim, name))) == []


def test_a_docstring_without_a_shape_is_found():
    class Bare:
        """Some numbers (metres)."""

        values: np.ndarray

        def twice(self) -> np.ndarray:
            """The values (of all) twice."""

        @property
        def good(self) -> np.ndarray:
            """(n, 3) metres."""

    found = list(complaints("Bare", Bare))
    assert found == [
        "Bare has no shape of ['values']",
        "Bare does not name values",
        "Bare.twice has no shape of ['return']",
    ]
    Bare.__doc__ = "(n,) in metres."
    assert list(complaints("Bare", Bare))[0] == "Bare does not name values"
