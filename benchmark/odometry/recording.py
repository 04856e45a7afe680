"""Runs of odometers for the Rerun viewer: ground truth and estimates, errors, residuals,
uncertainty, and flags of lost, degenerate and not converged frames.
"""

from collections.abc import Sequence

import numpy as np
from iclnuim.errors import InputError, StrPath
from iclnuim.evaluation.absolute_error import absolute_error
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.report.recording import TRUTH, Recorder, record
from iclnuim.shown import COLOURS

from .protocol import OdometryStatus
from .run import OdometryRun
from .track import Tracked

#: Fields of a result that are recorded as curves.
_CURVES = ("residual", "inliers", "largest_sigma_m", "smallest_eigenvalue", "iterations", "seconds")


def record_runs(
    path: StrPath, folder: StrPath, runs: Sequence[OdometryRun], camera: PinholeCamera
) -> None:
    """Record runs of a sequence as world/METHOD, error_m/METHOD, residual/METHOD and so on.
    flags/METHOD is a text log with a line for each lost, degenerate or not converged frame.
    Estimates are aligned with the ground truth, if any, by SE(3). Raises WorkError without
    rerun-sdk.
    """

    def fill(recorder: Recorder) -> None:
        truth = next((run.truth for run in runs if run.truth is not None), None)
        if truth is not None:
            recorder.trajectory("world/truth", truth.positions_m, TRUTH)
        for k, run in enumerate(runs):
            hexes = COLOURS[k % len(COLOURS)].lstrip("#")
            red, green, blue = (int(hexes[n : n + 2], 16) for n in (0, 2, 4))
            _run(recorder, run, (red, green, blue), camera)

    record(path, folder, fill)


def _run(
    recorder: Recorder, run: OdometryRun, colour: tuple[int, int, int], camera: PinholeCamera
) -> None:
    name, (T_truth_world, errors_m) = run.name.replace(":", "_"), _aligned(run)
    tracked = [frame for frame in run.frames if not frame.lost]
    places = T_truth_world.apply(
        np.array([frame.T_world_camera.translation for frame in tracked]).reshape(-1, 3)
    )
    recorder.trajectory(f"world/{name}/trajectory", places, colour)
    recorder.camera(f"world/{name}/camera/image", camera)
    for curve in ("error_m", *_CURVES):
        recorder.curve(f"{curve}/{name}", run.name, colour)
    for number, frame in enumerate(run.frames):
        recorder.at(frame.stamp_s, number)
        recorder.pose(f"world/{name}/camera", T_truth_world @ frame.T_world_camera)
        recorder.scalar(f"error_m/{name}", errors_m.get(frame.stamp_s, np.nan))
        for curve in _CURVES:
            recorder.scalar(
                f"{curve}/{name}", np.nan if frame.lost else getattr(frame.result, curve)
            )
        if flag := _flag(frame):
            level = "ERROR" if frame.lost else "WARN"
            recorder.log(f"flags/{name}", recorder.rerun.TextLog(flag, level=level))


def _flag(frame: Tracked) -> str:
    """Why a frame's pose is not reliable; "" if it is."""
    result = frame.result
    words = [f"lost: {result.reason}"] if frame.lost else []
    words += ["degenerate"] if result.status is OdometryStatus.DEGENERATE else []
    words += ["not converged"] if not frame.lost and not result.converged else []
    return ", ".join(words)


def _aligned(run: OdometryRun) -> tuple[SE3, dict[float, float]]:
    """T_truth_world, and errors in metres by the estimate's stamps. Without ground truth, or if the
    alignment is undetermined, the identity and no errors.
    """
    try:
        if run.truth is None or all(frame.lost for frame in run.frames):
            return SE3.identity(), {}
        estimate = run.trajectory
        error = absolute_error(run.truth, estimate)
    except InputError:
        return SE3.identity(), {}
    stamps_s = estimate.stamps_s[error.association.second].tolist()
    return error.alignment.T_reference_estimate, dict(
        zip(stamps_s, error.translation_error_m.tolist(), strict=True)
    )
