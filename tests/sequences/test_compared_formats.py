"""`iclnuim compare` on a sequence of every format."""

import json
import shutil

import numpy as np
import pytest
from iclnuim.formats.exr import write_exr
from iclnuim.formats.files import write_json
from iclnuim.formats.images import ARRAY, EXR, write_array
from iclnuim.formats.png import read_depth16, write_png
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.stored_sequence import StoredSequence, read_depth_m


@pytest.mark.parametrize("options", [(), ("--tolerance",)])
@pytest.mark.parametrize("name", FORMATS)
def test_a_sequence_is_equal_to_itself_and_to_none_of_another_depth(
    all_formats, tmp_path, command_here, name, options
):
    two = (tmp_path / "a", tmp_path / "b")
    for folder in two:
        shutil.copytree(all_formats / name, folder)
        write_json(folder / "recipe.json", {})
    assert command_here("compare", *options, two[0], two[0])[0] == 0
    assert command_here("compare", *options, *two)[0] == 0
    pair = StoredSequence(two[1]).pairs[0]
    units = StoredSequence(two[1]).camera_of(pair.rgb).depth_units_per_metre
    if pair.depth.suffix == ARRAY:
        write_array(pair.depth, read_depth_m(pair.depth, units) + 0.004)
    elif pair.depth.suffix == EXR:
        write_exr(pair.depth, {"R": read_depth_m(pair.depth, units) + np.float32(0.004)})
    else:
        write_png(pair.depth, read_depth16(pair.depth) + np.uint16(0.004 * units))
    code, out, _ = command_here("compare", *options, *two, "--json")
    changed = pair.depth.relative_to(two[1]).as_posix()
    assert code == 3 and json.loads(out)["different"] == {changed: ["depth"]}


def test_the_depth_of_each_of_several_formats_has_its_own_units(
    all_formats, tmp_path, command_here
):
    """Two units: 2 mm in ScanNet's, 0.4 mm in TUM's."""
    other = shutil.copytree(all_formats, tmp_path / "b")
    changed = [StoredSequence(other / name).pairs[0].depth for name in ("tum", "scannet")]
    for depth in changed:
        write_png(depth, read_depth16(depth) + np.uint16(2))
    code, out, _ = command_here("compare", "--tolerance", all_formats, other, "--json")
    assert code == 3
    assert list(json.loads(out)["different"]) == [changed[1].relative_to(other).as_posix()]
