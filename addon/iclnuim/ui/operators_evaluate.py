"""Operators of evaluation: errors of an estimate as text and in the 3D view, and over time as a plot."""

import bpy

from ..errors import InputError
from ..evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings, absolute_error
from ..evaluation.align import AlignmentSettings
from ..evaluation.relative_error import RelativeError, RelativeErrorSettings, parse_delta, relative_error
from ..formats.trajectories import read_trajectory
from . import image_editor, inputs, state, trajectory_view
from .pictures import error_plot
from .state import reported

PLOT = "ICL-NUIM error"


class ICLNUIM_OT_evaluate(bpy.types.Operator):
    """ATE and RPE of the estimate, which is drawn beside the ground truth: blue for no error, red for the largest"""

    bl_idname, bl_label = "iclnuim.evaluate", "Evaluate"

    @reported
    def execute(self, context):
        settings, held = context.scene.iclnuim, state.current()
        if not settings.estimate:
            raise InputError("an estimated trajectory", found="none", hint="choosing a file as {estimate}")
        estimate = read_trajectory(bpy.path.abspath(settings.estimate))
        truth = (
            read_trajectory(bpy.path.abspath(settings.truth)).trajectory
            if settings.truth
            else inputs.trajectory(context)[0]
        )
        alignment = AlignmentSettings(**settings.values_of(AlignmentSettings))
        ate = absolute_error(truth, estimate.trajectory, AbsoluteErrorSettings(alignment=alignment))
        rpe = relative_error(truth, estimate.trajectory, RelativeErrorSettings(*parse_delta(settings.delta)))
        held.evaluation, held.evaluation_lines = ate, _lines(ate, rpe, settings.delta)
        trajectory_view.show_estimate(ate.aligned.translation, ate.reference.translation, ate.translation_error_m)
        state.redraw()


class ICLNUIM_OT_plot(bpy.types.Operator):
    """Plot the error over time in the image editor"""

    bl_idname, bl_label = "iclnuim.plot", "Show the Plot"

    @reported
    def execute(self, context):
        ate = state.current().evaluation
        if ate is None:
            raise InputError("an evaluation to plot", found="none", hint="Evaluate first")
        image_editor.show(context, PLOT, error_plot(ate.stamps_s, ate.translation_error_m, ate.translation_m.rmse))


def _lines(ate: AbsoluteError, rpe: RelativeError, delta: str) -> list[str]:
    a, r = ate.translation_m, ate.rotation_deg
    return [
        f"ATE rmse {a.rmse:.4f} m, median {a.median:.4f}, max {a.max:.4f}",
        f"rotation rmse {r.rmse:.3f} deg",
        f"RPE over {delta}: {rpe.translation_m.rmse:.4f} m, {rpe.rotation_deg.rmse:.3f} deg",
        f"{len(ate.stamps_s)} pairs, {100 * ate.completeness.coverage:.0f} % of the ground truth",
    ]


register, unregister = bpy.utils.register_classes_factory((ICLNUIM_OT_evaluate, ICLNUIM_OT_plot))
