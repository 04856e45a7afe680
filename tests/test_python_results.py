"""What the public names take and give back: functions as noise, matrices as poses, results that
show themselves, progress, old names.
"""

import inspect
import json
import subprocess
import sys
import types
import warnings

import iclnuim
import numpy as np
import pytest
from iclnuim import SE3, InputError, Trajectory, console
from iclnuim.headless import cli

sys.modules.setdefault("matplotlib", __import__("matplotlib")).use("Agg")

POSES = SE3.exp(np.random.default_rng(0).normal(size=(8, 6)) * 0.2)
MOVED = POSES @ SE3.exp(np.random.default_rng(1).normal(size=(8, 6)) * 0.01)
SHIFT = np.zeros((4, 4))
SHIFT[2, 3] = -0.6
CAMERA = "16x12,16,-16,7.5,5.5"


def look(number):
    return np.full((12, 16, 3), 0.2 + 0.02 * number), np.full((12, 16), 2.0 + 0.1 * number)


@pytest.fixture
def sequence(tmp_path):
    frames = iclnuim.frames_from(CAMERA, POSES.matrix, look)
    iclnuim.make_sequence(frames, tmp_path / "clean", workers=1)
    return iclnuim.open_sequence(tmp_path / "clean")


def deeper(depth_z_m, camera, rng, by_m=0.5):
    return depth_z_m + by_m + 0 * rng.normal(size=depth_z_m.shape)


def test_a_function_is_a_noise_model_wherever_a_name_is(sequence, tmp_path):
    depth_z_m = look(0)[1]
    assert np.array_equal(iclnuim.noisy_depth(depth_z_m, deeper, CAMERA), depth_z_m + 0.5)
    more = iclnuim.noisy_depth(depth_z_m, deeper, settings={"by_m": 1})
    assert np.array_equal(more, depth_z_m + 1)
    rgb = iclnuim.noisy_rgb(look(0)[0], lambda light, rng: (255 * light).astype(np.uint8))
    assert rgb.max() == 51
    iclnuim.make_sequence(sequence, tmp_path / "own", depth_noise=deeper, workers=1)
    opened = iclnuim.open_sequence(tmp_path / "own")
    np.testing.assert_allclose(opened[3].depth_z_m, 2.8, atol=1e-4)
    recipe = json.loads((tmp_path / "own/recipe.json").read_text())
    assert "deeper" in json.dumps(recipe)
    model = iclnuim.depth_model("kinect2012")
    assert iclnuim.depth_model(model) is model


def test_a_function_that_changed_is_noticed_when_a_sequence_is_resumed(sequence, tmp_path):
    def noise(by_m):
        return lambda depth_z_m, camera, rng: depth_z_m + by_m

    iclnuim.make_sequence(sequence, tmp_path / "own", depth_noise=noise(0.1), workers=1)
    iclnuim.make_sequence(sequence, tmp_path / "own", depth_noise=noise(0.1), workers=1)
    with pytest.raises(InputError, match="another image of frame 0"):
        iclnuim.make_sequence(sequence, tmp_path / "own", depth_noise=noise(0.2), workers=1)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (lambda depth_z_m: depth_z_m, r"a function to call as .*depth_z_m, camera, rng"),
        (int, "a depth noise model"),
        (3, "a depth noise model"),
        (iclnuim.depth_model("paper"), "by name with its settings"),
        (lambda depth_z_m, camera, rng, a: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_what_is_no_noise_is_refused(model, said):
    with pytest.raises(InputError, match=said):
        iclnuim.noisy_depth(look(0)[1], model, settings={"a": 1} if said != "x" else None)


def test_a_part_of_a_sequence_is_written_with_its_numbers(sequence, tmp_path):
    made = iclnuim.make_sequence(sequence[2:5], tmp_path / "part", workers=1)
    part = iclnuim.open_sequence(made.folders[0])
    assert made.made == 3 and part.stamps_s.tolist() == sequence.stamps_s[2:5].tolist()
    for one, other in zip(part, sequence[2:5], strict=True):
        assert np.array_equal(one.depth_z_m, other.depth_z_m)
        assert np.allclose(one.T_world_camera.matrix, other.T_world_camera.matrix, atol=1e-6)


def test_errors_are_computed_of_matrices_lists_and_trajectories():
    truth = Trajectory.at_rate(POSES)
    for measure in (iclnuim.absolute_trajectory_error, iclnuim.relative_pose_error):
        expected = measure(truth, Trajectory.at_rate(MOVED)).translation_m.rmse
        for one in (truth, POSES, POSES.matrix, list(POSES.matrix)):
            for other in (MOVED, MOVED.matrix, list(MOVED), Trajectory.at_rate(MOVED)):
                assert measure(one, other).translation_m.rmse == pytest.approx(expected)
        late = Trajectory(truth.stamps_s + 100, POSES)
        assert measure(late, MOVED).translation_m.rmse == pytest.approx(expected)
        with pytest.raises(InputError, match="as many lines .* 8, found 7 lines"):
            measure(truth, MOVED.matrix[:7])
        for wrong in (None, 3, np.eye(4), [[1, 2]]):
            with pytest.raises(InputError, match="a Trajectory, a file, a sequence, poses"):
                measure(truth, wrong)


def test_what_takes_a_trajectory_takes_matrices(tmp_path):
    trajectory = Trajectory.at_rate(POSES)
    for poses in (POSES.matrix, list(POSES.matrix), POSES):
        iclnuim.write_trajectory(tmp_path / "a.txt", poses, "tum")
        read = iclnuim.read_trajectory(tmp_path / "a.txt").trajectory
        np.testing.assert_allclose(read.T_world_camera.matrix, POSES.matrix, atol=1e-6)
        assert iclnuim.trajectory_statistics(poses) == iclnuim.trajectory_statistics(trajectory)
        assert len(iclnuim.resample(poses, 60)) == 15
    with pytest.raises(InputError, match="expected a Trajectory, found str; try .*read_trajectory"):
        iclnuim.trajectory_statistics("a.txt")


def test_an_opened_sequence_is_taken_where_its_folder_is(sequence):
    assert iclnuim.inspect_sequence(sequence).figures["pairs"] == 8
    settings = iclnuim.ViewSettings(lpips=False)
    assert len(iclnuim.view_errors(sequence, sequence, settings=settings).views) == 8
    for truth in (sequence, str(sequence.folder)):
        assert iclnuim.absolute_trajectory_error(truth, POSES).translation_m.rmse < 1e-5
    with pytest.raises(InputError, match="found a part of a sequence; try make_sequence"):
        iclnuim.inspect_sequence(sequence[:3])


def test_odometers_run_by_name_and_without_a_list(sequence):
    pytest.importorskip("cv2")
    for given in (iclnuim.odometer("icp"), "icp", ["icp"]):
        (run,) = iclnuim.run_odometers(given, sequence[:2], progress=False)
        assert run.name == "icp"
    with pytest.raises(InputError, match="an odometer"):
        iclnuim.run_odometers("icp2", sequence)


def test_reprs_are_short(sequence, tmp_path):
    written = iclnuim.make_sequence(sequence[:2], tmp_path / "o", workers=1)
    found = iclnuim.trajectory_statistics(POSES)
    view = iclnuim.HeldOutView(0.123456789, 1 / 3, 0.0)
    assert repr(view) == "HeldOutView(distance_m=0.123457, angle_deg=0.333333, unseen=0)"
    assert repr(written).endswith("o, 2 frames made, 0 found)")
    assert len(repr(found)) < 230


@pytest.mark.parametrize("error", ["ate", "rpe"])
def test_python_gives_the_warnings_of_the_command(tmp_path, capsys, repository, error):
    truth = repository / "trajectories/living_room/kt2.txt"
    estimate = tmp_path / "estimate.txt"
    poses = iclnuim.read_trajectory(truth).trajectory.T_world_camera
    late = Trajectory(1 + np.arange(len(poses)) / 25, poses)
    iclnuim.write_trajectory(estimate, late, "tum")
    assert cli.main(["evaluate", error, str(truth), str(estimate), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)["warnings"]
    names = {"ate": iclnuim.absolute_trajectory_error, "rpe": iclnuim.relative_pose_error}
    found = names[error](truth, estimate)
    assert list(found.warnings) == said and "30 poses a second instead of 25" in repr(found)
    as_given = names[error](iclnuim.read_trajectory(truth).trajectory, late)
    assert as_given.warnings[0][:90] == said[0][:90]
    assert names[error](truth, truth).warnings == ()


def results():
    from iclnuim.sequences.rendered_views import ViewError, ViewErrors

    truth = Trajectory.at_rate(POSES)
    cube = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3]])
    surface = iclnuim.TrueSurface(cube, faces)
    settings = iclnuim.QualitySettings(samples=1000)
    tracked = [
        iclnuim.Tracked(t, T, iclnuim.OdometryResult(np.eye(4)))
        for t, T in Trajectory.at_rate(MOVED)
    ]
    return [
        iclnuim.absolute_trajectory_error(POSES, MOVED),
        iclnuim.relative_pose_error(POSES, MOVED),
        surface.error(cube + 0.01, np.eye(4)),
        iclnuim.surface_quality(surface, cube, faces, np.eye(4), whole=True, settings=settings),
        ViewErrors((ViewError("0", True, 30.0, 0.9),)),
        iclnuim.OdometryRun("mine", tracked, truth),
        iclnuim.OdometryRun("mine", tracked, None),
    ]


def test_results_are_described_listed_and_drawn():
    pytest.importorskip("igl", reason="libigl is not installed")
    from matplotlib import pyplot
    from matplotlib.axes import Axes

    for result in results():
        name = type(result).__name__
        assert repr(result).startswith(f"{name}(") and len(repr(result)) < 130
        assert json.loads(json.dumps(result.to_dict())) == result.to_dict()
        html = result._repr_html_()
        assert html.count("<tr>") == html.count("</tr>") >= 3 and "<table>" in html
        axes = result.plot()
        assert isinstance(axes, Axes) and axes.lines and axes.get_xlabel()
        assert result.plot(axes) is axes
        pyplot.close("all")
    assert "mm" in repr(results()[0])


@pytest.mark.parametrize("name", iclnuim.__all__)
def test_no_repr_prints_the_numbers_of_an_array(name):
    public = getattr(iclnuim, name)
    fields = getattr(public, "__dataclass_fields__", {}).values()
    if inspect.isclass(public) and any("ndarray" in str(field.type) for field in fields):
        made_by_dataclass = hasattr(vars(public).get("__repr__"), "__wrapped__")
        assert not made_by_dataclass


def test_an_array_in_a_repr_is_its_shape():
    mesh = iclnuim.Mesh(np.zeros((400, 3)), np.zeros((0, 3), int), np.zeros((400, 0), np.uint8))
    assert repr(mesh).startswith("Mesh(points=float64 (400, 3), triangles=int64 (0, 3), colours=")
    association = iclnuim.associate(np.arange(3.0), np.arange(3.0))
    assert "first=int64 (3,)" in repr(association) and "first_count=3" in repr(association)


def test_an_inspection_lists_its_findings(sequence):
    found = iclnuim.inspect_sequence(sequence.folder)
    assert repr(found).endswith(f"{len(found.errors)} errors, {len(found.warnings)} warnings)")
    assert found.to_dict()["figures"]["pairs"] == 8 and found._repr_html_()


def test_sequences_are_compared_by_their_files(sequence, tmp_path):
    iclnuim.make_sequence(sequence, tmp_path / "same", workers=1)
    iclnuim.make_sequence(sequence, tmp_path / "noisy", depth_noise="kinect2012", workers=1)
    same = iclnuim.compare_sequences(tmp_path / "same", str(tmp_path / "same"))
    assert same.same and same.images == 16 and "0 files differ" in repr(same)
    found = iclnuim.compare_sequences(tmp_path / "same", tmp_path / "noisy")
    assert not found.same and len(found.different) == 8
    assert {name.split("/")[0] for name in found.different} == {"depth"}
    assert json.loads(json.dumps(found.to_dict())) == found.to_dict() and found._repr_html_()
    with pytest.raises(InputError, match="neither"):
        iclnuim.compare_sequences(sequence, tmp_path)


def test_figures_of_an_error_are_those_of_its_parts():
    error = iclnuim.absolute_trajectory_error(POSES, MOVED)
    figures = error.to_dict()
    assert figures["translation_error_m"]["rmse"] == error.translation_m.rmse
    assert figures["pairs"] == 8 and figures["coverage"] == 1 and figures["scale"] == 1
    shown = error.plot().lines[0].get_ydata()
    np.testing.assert_allclose(shown, 1e3 * error.translation_error_m)
    relative = iclnuim.relative_pose_error(POSES, MOVED)
    assert relative.to_dict()["errors"] == 7 == len(relative.error_stamps_s)


def test_images_are_shown_in_a_notebook(sequence):
    frame = iclnuim.RenderedFrame(*look(0))
    for shown in (sequence, sequence[0], frame):
        assert "data:image/png;base64," in shown._repr_html_()
    assert repr(frame) == "RenderedFrame(16x12)"
    assert sequence[:0]._repr_html_()


def test_progress_is_shown_on_request_and_in_a_notebook(sequence, tmp_path, capsys, monkeypatch):
    counted = []

    def progress(total, label):
        counted.append((total, label))
        return types.SimpleNamespace(advance=lambda: counted.append(1))

    iclnuim.make_sequence(sequence, tmp_path / "a", progress=progress, workers=1)
    assert counted == [(8, "sequence")] + [1] * 8
    assert capsys.readouterr().err == ""
    iclnuim.make_sequence(sequence, tmp_path / "b", workers=1)
    assert capsys.readouterr().err == ""
    iclnuim.make_sequence(sequence, tmp_path / "c", progress=True, workers=1)
    assert "sequence: 8/8 frames" in capsys.readouterr().err
    bars = notebook(monkeypatch)
    assert console.in_notebook()
    iclnuim.make_sequence(sequence, tmp_path / "d", workers=1)
    assert len(bars) == 1 and "sequence: 8/8 frames" in bars[0]["text/plain"]
    assert '<progress value="8" max="8">' in bars[0]["text/html"]
    iclnuim.make_sequence(sequence, tmp_path / "e", progress=False, workers=1)
    assert capsys.readouterr().err == "" and len(bars) == 1


def notebook(monkeypatch):
    """Take this process for a notebook's kernel, and return what is shown in its cell."""
    shown = []

    def display(content, raw, display_id):
        place = len(shown)
        shown.append(content)
        return types.SimpleNamespace(update=lambda content, raw: shown.__setitem__(place, content))

    shell = types.SimpleNamespace(kernel=1)
    python = types.SimpleNamespace(get_ipython=lambda: shell)
    monkeypatch.setitem(sys.modules, "IPython", python)
    monkeypatch.setitem(sys.modules, "IPython.display", types.SimpleNamespace(display=display))
    return shown


def test_a_table_is_in_millimetres_and_degrees():
    error = iclnuim.relative_pose_error(POSES, MOVED)
    shown = error._repr_html_()
    rmse_mm = f"{1e3 * error.translation_m.rmse:.6g} mm"
    assert f"<td>{rmse_mm}</td>" in shown and "_m." not in shown and "_rad" not in shown


LONG = ("make_sequence", "render_frames", "run_odometers", "fuse_sequence", "view_errors")


@pytest.mark.parametrize("name", LONG)
def test_long_work_takes_progress(name):
    assert inspect.signature(getattr(iclnuim, name)).parameters["progress"].default is None


def test_one_pose_comes_from_a_pov_camera(tmp_path):
    text = "cam_pos = [91, 465, -292]';\ncam_dir = [0.3, -0.1, 1]';\ncam_up = [0, 1, 0.1]';\n"
    (tmp_path / "scene_00_0012.txt").write_text(text)
    T = iclnuim.pose_from_pov(tmp_path / "scene_00_0012.txt", unit_m=0.01)
    np.testing.assert_allclose(T.translation, [-0.91, 2.92, 4.65])
    ahead = np.array([0.3, -0.1, 1])
    expected = np.array([-0.3, -1, -0.1]) / np.linalg.norm(ahead)
    np.testing.assert_allclose(T.rotation[:, 2], expected)
    same = iclnuim.pose_from_pov([91, 465, -292], ahead, (0, 1, 0.1), unit_m=0.01)
    np.testing.assert_allclose(same.matrix, T.matrix)
    level = iclnuim.pose_from_pov((0, 1, 0), (0, 0, 1))
    np.testing.assert_allclose(level.rotation[:, 1], [0, 0, -1])  # y of the image is down
    for wrong in (([0, 1], [0, 0, 1]), ([0, 1, 0], [0, 1, 0]), ([0, 1, np.nan], [0, 0, 1])):
        with pytest.raises(InputError):
            iclnuim.pose_from_pov(*wrong)
    for wrong in ((tmp_path, None), ([0, 1, 0], None), (tmp_path / "scene_00_0012.txt", [0, 0, 1])):
        (tmp_path / "scene_00_0013.txt").write_text(text)
        with pytest.raises(InputError):
            iclnuim.pose_from_pov(*wrong)


def test_only_the_public_names_are_listed():
    program = "import iclnuim; print(dir(iclnuim) == sorted(iclnuim.__all__))"
    done = subprocess.run(
        [sys.executable, "-c", f"{program}; iclnuim.SE3; {program}"], capture_output=True, text=True
    )
    assert done.stdout.split() == ["True", "True"]


@pytest.mark.parametrize("name", iclnuim._OLD)
def test_an_old_name_works_and_says_so_once(name):
    assert name not in iclnuim.__all__
    vars(iclnuim).pop(name, None)
    with pytest.warns(
        DeprecationWarning, match=f"iclnuim.{name} is an old name; try iclnuim."
    ) as w:
        value = getattr(iclnuim, name)
    assert callable(value) and w[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert getattr(iclnuim, name) is value
    vars(iclnuim).pop(name)


@pytest.mark.parametrize("name", iclnuim.__all__)
def test_classes_and_functions_have_one_name(name):
    public = getattr(iclnuim, name)
    if inspect.isclass(public) or inspect.isfunction(public):
        assert public.__name__ == name


def test_cameras_as_text_and_poses_as_matrices_are_taken_where_rays_are_cast():
    pytest.importorskip("embreex", reason="embreex is not installed")
    wall = np.array([[-9, -9, 2], [9, -9, 2], [0, 18, 2.0]])
    caster = iclnuim.RayCaster(wall, np.array([[0, 1, 2]]))
    assert np.allclose(caster.depth(CAMERA, np.eye(4)), 2)
    views = SE3.exp([[1.0, 0, 0, 0, 0, 0]]).matrix
    (held,) = iclnuim.check_held_out(caster, CAMERA, views, [np.eye(4), views[0] + SHIFT])
    assert held.distance_m == pytest.approx(0.6)
    seen = iclnuim.SeenBy(CAMERA, views)
    assert seen.camera.fy == 16 and seen.T_world_camera.shape == (1,)
    tracker = iclnuim.Tracker(iclnuim.odometer("icp"), CAMERA)
    assert tracker.camera == seen.camera
    job = iclnuim.RenderJob("a", "living_room", "kt2", camera="80x60")
    assert job.camera.width == 80


def test_a_sequence_and_its_parts_are_tracked_and_fused(sequence):
    pytest.importorskip("numba", reason="numba is not installed")
    (run,) = iclnuim.run_odometers([iclnuim.odometer("icp")], sequence[:3])
    assert len(run.frames) == 3 and len(run.truth) == 8
    with pytest.raises(InputError, match="as many poses as stamps"):
        iclnuim.fuse_sequence(sequence, POSES.matrix[:3])
    assert sequence.stored.images(sequence.pairs[0])[1].shape == (12, 16)


def test_a_pose_is_an_array_of_its_matrix():
    assert np.array_equal(np.asarray(POSES), POSES.matrix)
    assert np.asarray(POSES[0], np.float32).dtype == np.float32
    assert np.array_equal(np.array(POSES[0], copy=True), POSES[0].matrix)


def test_a_matrix_times_poses_is_their_composition():
    product = SHIFT + np.eye(4)
    np.testing.assert_allclose((product @ POSES).matrix, product @ POSES.matrix)
    with pytest.raises(TypeError):
        product * POSES


def test_the_ate_takes_an_alignment_by_name_and_gives_its_rmse():
    scaled = SE3(MOVED.rotation, 2 * MOVED.translation)
    error = iclnuim.absolute_trajectory_error(POSES, scaled, alignment="sim3")
    assert error.alignment.scale == pytest.approx(0.5, abs=0.05)
    assert error.rmse_mm == 1e3 * error.rmse_m == 1e3 * error.translation_m.rmse
    assert error.rmse_m < iclnuim.absolute_trajectory_error(POSES, scaled).rmse_m
    with pytest.raises(InputError, match="se3"):
        iclnuim.absolute_trajectory_error(POSES, scaled, alignment="sim(3)")


def test_the_ate_of_positions_and_of_rows_is_that_of_poses():
    expected = iclnuim.absolute_trajectory_error(POSES, MOVED).rmse_m
    of_positions = iclnuim.absolute_trajectory_error(POSES.translation, MOVED.translation)
    assert of_positions.rmse_m == pytest.approx(expected)
    stamps_s = np.arange(8.0)[:, None]
    rows = [np.hstack([stamps_s, T.translation, T.quat_xyzw]) for T in (POSES, MOVED)]
    assert iclnuim.absolute_trajectory_error(*rows).rmse_m == pytest.approx(expected)
    with pytest.raises(InputError, match=r"found \(8, 5\)"):
        iclnuim.absolute_trajectory_error(POSES, np.zeros((8, 5)))


def test_built_in_trajectories_have_names(sequence):
    assert "living_room/kt2" in iclnuim.sequence_names()
    loaded = iclnuim.read_trajectory("living_room/kt2")
    assert iclnuim.absolute_trajectory_error("living_room/kt2", loaded.trajectory).rmse_m < 1e-9


def test_a_sequence_is_converted_in_a_line(sequence, tmp_path):
    iclnuim.convert_sequence(sequence[2:5], tmp_path / "k", "colmap")
    assert len(iclnuim.open_sequence(tmp_path / "k")) == 3


def test_noise_that_is_not_finite_is_missing(sequence, tmp_path):
    def holes(depth_z_m, camera, rng):
        return np.where(np.arange(16) < 3, np.nan, depth_z_m)

    noisy = iclnuim.noisy_depth(look(0)[1], holes, CAMERA)
    assert (noisy[:, :3] == 0).all() and (noisy[:, 3:] == 2).all()


def test_a_camera_from_its_field_of_view_sees_that_angle():
    camera = iclnuim.PinholeCamera.from_fov(640, 480, 90)
    assert (camera.fx, camera.fy) == pytest.approx((320, 320))
    edges = (np.array([-0.5, 639.5]) - camera.cx) / camera.fx
    assert np.degrees(np.arctan(edges)) == pytest.approx([-45, 45])
