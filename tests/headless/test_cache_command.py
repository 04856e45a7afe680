"""`iclnuim cache` says where the cache is and how large, and clears what it knows."""

import json

import pytest
from iclnuim.headless.cli import main


@pytest.fixture
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    monkeypatch.setenv("ICLNUIM_CACHE", str(folder))
    for name, size in (("light/a/map.exr", 3_000_000), ("bags/b/rgb/0.png", 200_000)):
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_bytes(bytes(size))
    (folder / "mine.txt").write_text("not the cache's")
    return folder


def test_where_it_is_and_how_large(cache, capsys):
    assert main(["cache"]) == 0
    first, *kinds = capsys.readouterr().out.splitlines()
    assert first == f"{cache}: 3.2 MB"
    assert [line.split()[:3] for line in kinds] == [["light", "3.0", "MB"], ["bags", "0.2", "MB"]]
    assert (cache / "light/a/map.exr").is_file()


def test_clearing_says_what_it_removed_and_leaves_what_is_not_its_own(cache, capsys):
    assert main(["cache", "--clear", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["bytes_by_folder"]["light"] == 3_000_000 and found["cleared"]
    assert [path.name for path in cache.iterdir()] == ["mine.txt"]
    assert main(["cache", "--clear"]) == 0
    assert capsys.readouterr().out == f"{cache}: 0.0 MB\n"


def test_each_removed_kind_is_named(cache, capsys):
    main(["cache", "--clear"])
    removed = capsys.readouterr().out.splitlines()[1:]
    assert [line.split()[:2] for line in removed] == [["removed", "light"], ["removed", "bags"]]


def test_a_link_in_the_cache_is_removed_and_what_it_leads_to_stays(cache, tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "map.exr").write_bytes(b"1")
    (cache / "simulations").symlink_to(kept)
    assert main(["cache", "--clear", "--quiet"]) == 0
    assert (kept / "map.exr").is_file() and not (cache / "simulations").exists()


def test_what_cannot_be_removed_is_one_line_and_work_that_failed(cache, capsys, monkeypatch):
    def refuse(folder):
        raise PermissionError(13, "Permission denied", str(folder))

    monkeypatch.setattr("shutil.rmtree", refuse)
    assert main(["cache", "--clear"]) == 3
    assert f"{cache}/light: Permission denied" in capsys.readouterr().err


def test_every_folder_that_the_library_makes_in_the_cache_is_known(repository):
    import re

    from iclnuim.headless.commands.cache import KINDS

    named = set()
    for room in ("addon", "headless", "benchmark", "tools"):
        for path in (repository / room).rglob("*.py"):
            named |= set(re.findall(r'cache(?:_folder\(\))? / f?"(\w+)', path.read_text()))
    assert named and named <= set(KINDS)
