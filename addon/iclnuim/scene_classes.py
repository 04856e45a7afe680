"""What kinds of things there are, their numbers in label images, and what NYU40 calls them. Plain Python, no Blender."""

from dataclasses import dataclass

#: The 40 labels of NYU Depth v2 as Gupta, Arbelaez and Malik (CVPR 2013) reduced them; number 1 comes first.
NYU40 = (
    "wall", "floor", "cabinet", "bed", "chair", "sofa", "table", "door", "window", "bookshelf",
    "picture", "counter", "blinds", "desk", "shelves", "curtain", "dresser", "pillow", "mirror", "floor mat",
    "clothes", "ceiling", "books", "refrigerator", "television", "paper", "towel", "shower curtain", "box", "whiteboard",
    "person", "night stand", "toilet", "sink", "lamp", "bathtub", "bag", "otherstructure", "otherfurniture", "otherprop",
)  # fmt: skip
UNLABELLED = "unlabelled"
#: Kinds in a user's own scene that are not in the table are numbered from here on, in alphabetical order.
FIRST_OWN = 1000

#: Our kinds and their NYU40 label, None where NYU40 has no word for it (what lies outside the window). Their order is their number:
#: new ones go to the end, so that old label images keep their meaning.
_LABELS = {
    "wall": "wall", "floor": "floor", "ceiling": "ceiling", "door": "door", "window": "window", "moulding": "otherstructure",
    "railing": "otherstructure", "backdrop": None, "sofa": "sofa", "chair": "chair", "table": "table", "cabinet": "cabinet",
    "desk": "desk", "bookcase": "bookshelf", "stand": "otherfurniture", "lamp": "lamp", "pillow": "pillow", "blanket": "otherprop",
    "curtain": "curtain", "rug": "floor mat", "picture": "picture", "television": "television", "books": "books", "paper": "paper",
    "plant": "otherprop", "pot": "otherprop", "vase": "otherprop", "fruit": "otherprop", "plate": "otherprop", "mug": "otherprop",
    "jar": "otherprop", "box": "box", "basket": "otherprop", "monitor": "otherprop", "keyboard": "otherprop", "mouse": "otherprop",
    "computer": "otherprop", "cable": "otherprop", "phone": "otherprop", "tray": "otherprop", "stapler": "otherprop",
    "folder": "otherprop", "clock": "otherprop", "board": "otherprop", "socket": "otherprop", "handle": "otherprop",
    "vent": "otherstructure",
}  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """A kind of thing: its number in label images, its name, and its NYU40 label (0 and `unlabelled` where there is none)."""

    id: int
    name: str
    nyu40_id: int
    nyu40: str


def _kind(number: int, name: str, label: str | None) -> Kind:
    return Kind(number, name, NYU40.index(label) + 1 if label else 0, label or UNLABELLED)


#: name -> kind, of the shipped scenes
KINDS = {name: _kind(number, name, label) for number, (name, label) in enumerate(_LABELS.items(), 1)}
NO_KIND = Kind(0, UNLABELLED, 0, UNLABELLED)


def kinds_of(names: list[str | None]) -> dict[str | None, Kind]:
    """The kind for every name that occurs; None and an empty name have none. NYU40's own words are understood as well."""
    found: dict[str | None, Kind] = {n: KINDS.get(n, NO_KIND) if n else NO_KIND for n in names}
    for number, name in enumerate(sorted({n for n in names if n and n not in KINDS}), FIRST_OWN):
        found[name] = _kind(number, name, name if name in NYU40 else None)
    return found
