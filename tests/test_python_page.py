"""The examples of docs/guide/python.md, and then of python_methods.md, run as they are printed, one
after the other, in an empty folder; so does the README's.
"""

import re

import pytest

#: The second page continues the first.
PAGES = ("docs/guide/python.md", "docs/guide/python_methods.md")


def blocks(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(), re.S)


@pytest.fixture(scope="module")
def notebook(repository, tmp_path_factory):
    """The folder and the names that the examples leave."""
    folder, names = tmp_path_factory.mktemp("notebook"), {"__name__": "notebook"}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("MPLBACKEND", "Agg")
        for page in PAGES:
            for number, code in enumerate(blocks(repository / page), 1):
                exec(compile(code, f"{page}, example {number}", "exec"), names)
        yield folder, names


def test_the_page_has_an_example_for_each_common_task(repository):
    text = "\n".join(code for page in PAGES for code in blocks(repository / page))
    tasks = (
        "open_sequence",
        "absolute_trajectory_error",
        "noisy_depth",
        "make_sequence",
        "run_odometers",
        "render_pose",
        "fuse_sequence",
    )
    assert [task for task in tasks if task not in text] == []


def test_the_examples_run_and_their_results_are_sound(notebook):
    folder, names = notebook
    assert len(list((folder / "noisy/depth").glob("*.png"))) == 16
    rows = {run.name: run.to_dict() for run in names["runs"]}
    assert rows["icp_rgbd"]["ate_rmse_m"] < rows["centroid"]["ate_rmse_m"]
    assert all(row["lost"] == 0 for row in rows.values())
    assert names["error"].statistics.mean < 0.01
    assert names["frame"].depth_z_m.min() > 0 and names["frame"].rgb.shape == (60, 80, 3)


def test_the_example_of_the_readme_runs(notebook, repository, capsys):
    folder, _ = notebook
    noisy = folder / "out/living_room/kt2/noisy"
    noisy.mkdir(parents=True)
    (noisy / "groundtruth.txt").write_text((folder / "room/groundtruth.txt").read_text())
    (folder / "out/estimate.txt").write_text((folder / "estimate.txt").read_text())
    (code,) = blocks(repository / "README.md")
    exec(compile(code, "README.md", "exec"), {})
    assert re.fullmatch(r"ATE \d+\.\d{3} mm\n", capsys.readouterr().out)
