"""Operators of evaluation: an estimate against the truth in words and in the view, and the error over time as a picture."""

import bpy

from ..errors import InputError
from ..evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from ..evaluation.align import AlignmentSettings
from ..evaluation.relative_error import RelativeErrorSettings, parse_delta, relative_error
from ..formats.trajectories import read_trajectory
from . import images, inputs, session, viewport
from .messages import in_words
from .pictures import error_plot

PLOT = "ICL-NUIM error"


class ICLNUIM_OT_evaluate(bpy.types.Operator):
    """ATE and RPE of the estimate; it is drawn beside the truth, blue where it is right and red where it is worst"""

    bl_idname, bl_label = "iclnuim.evaluate", "Evaluate"

    @in_words
    def execute(self, context):
        settings, held = context.scene.iclnuim, session.current
        if not settings.estimate:
            raise InputError("an estimated trajectory", found="none", hint="choosing a file under Evaluate")
        estimate = read_trajectory(bpy.path.abspath(settings.estimate))
        truth = _truth(context, settings)
        ate = absolute_error(
            truth, estimate.trajectory, AbsoluteErrorSettings(alignment=AlignmentSettings(settings.alignment))
        )
        rpe = relative_error(truth, estimate.trajectory, RelativeErrorSettings(*parse_delta(settings.delta)))
        held.evaluation, held.evaluation_lines = ate, _lines(ate, rpe, settings.delta)
        viewport.set_estimate(ate.aligned.translation, ate.reference.translation, ate.translation_error_m)
        session.redraw()


class ICLNUIM_OT_plot(bpy.types.Operator):
    """The error over time as a picture in the image editor"""

    bl_idname, bl_label = "iclnuim.plot", "Show the Plot"

    @in_words
    def execute(self, context):
        ate = session.current.evaluation
        if ate is None:
            raise InputError("an evaluation to plot", found="none", hint="Evaluate first")
        images.show(context, PLOT, error_plot(ate.stamps_s, ate.translation_error_m, ate.translation_m.rmse))


def _truth(context, settings):
    if settings.truth:
        return read_trajectory(bpy.path.abspath(settings.truth)).trajectory
    return inputs.trajectory(context)[0]


def _lines(ate, rpe, delta: str) -> list[str]:
    a, r = ate.translation_m, ate.rotation_deg
    return [
        f"ATE rmse {a.rmse:.4f} m, median {a.median:.4f}, most {a.max:.4f}",
        f"rotation rmse {r.rmse:.3f} deg",
        f"RPE over {delta}: {rpe.translation_m.rmse:.4f} m, {rpe.rotation_deg.rmse:.3f} deg",
        f"{len(ate.stamps_s)} pairs, {100 * ate.completeness.coverage:.0f} % of the truth",
    ]


register, unregister = bpy.utils.register_classes_factory((ICLNUIM_OT_evaluate, ICLNUIM_OT_plot))
