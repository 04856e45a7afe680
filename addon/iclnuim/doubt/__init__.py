"""Why a file does not fit: what explains an error better than a poor estimate does.

Everything competes in `competition.py` by the errors that `fit.py` judges, as `change.py` of what
was read:

- an estimate and its ground truth: `against_truth.py` finds (`explain`), `explained_error.py` says.
  `hypotheses/` has the mistakes, `compared_poses.py` the errors, `time_axis.py` and `time_views.py`
  other stamps, `constant_transform.py` rotations and arms;
- depth images and their poses: `depth_against_poses.py` (`agreement`), with the mistakes in
  `depth_hypotheses.py` and the errors in `depth_pairs.py` (of `depth_blocks.py`) and
  `posed_depth.py`;
- an IMU and the poses of its camera: `imu_against_poses.py` (`imu_agreement`), with the mistakes in
  `imu_hypotheses.py` and the errors in `imu_evidence.py` and `imu_time.py`.

Surfaces compete in the benchmark (fusion/mistakes.py). By rules of their own: `frame_order.py`
(images of other frames), `lost_track.py`, `no_rotations.py`, `given_arrays.py`.
"""
