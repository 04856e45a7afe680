"""`iclnuim evaluate labels`: label images against the classes and instances of a sequence."""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import Any

from iclnuim.console import Console
from iclnuim.errors import named
from iclnuim.formats.files import atomic_write_text

from ..options import Actions, action, option_name

_TITLES = {
    "mean_iou": "mean IoU",
    "mean_iou_without_rare": "  without rare classes",
    "mean_iou_per_frame": "  mean over frames",
    "frequency_weighted_iou": "frequency-weighted IoU",
    "pixel_accuracy": "pixel accuracy",
    "mean_accuracy": "mean class accuracy",
    "unlabelled": "without a label",
    "panoptic_quality": "panoptic quality (PQ)",
    "segmentation_quality": "  SQ",
    "recognition_quality": "  RQ",
}
#: Columns of the table of classes.
_COLUMNS = {
    "share": "share",
    "iou": "IoU",
    "accuracy": "accuracy",
    "panoptic_quality": "PQ",
    "segmentation_quality": "SQ",
    "recognition_quality": "RQ",
}
#: Number of names in a note.
_NAMED = 5


def configure(actions: Actions) -> None:
    text = "label images against true classes: IoU, accuracies, panoptic quality"
    example = "iclnuim evaluate labels predicted --truth out/living_room/kt2/clean --classes nyu40"
    labels = action(actions, "labels", text, example, run)
    add = labels.add_argument
    help = (
        "label images (PNG), named or numbered like the images of SEQUENCE; instances in "
        "DIR/instance, if any"
    )
    add("folder", type=Path, metavar="DIR", help=help)
    help = "a sequence with ground truth, in any format"
    add("--truth", type=Path, required=True, metavar="SEQUENCE", help=help)
    add_classes(labels)
    add("--csv", metavar="FILE", help="write the confusion matrix as a CSV table")
    add("--plot", metavar="FILE", help="draw the confusion matrix (.png, .pdf, .svg)")


def add_classes(parser: ArgumentParser) -> None:
    """Add --classes."""
    help = (
        "numbering of the labels: ours (default), nyu40, scannet20, replica, or a table (.csv) "
        "with columns id and class, and red, green, blue for labels in colour"
    )
    parser.add_argument("--classes", default="ours", metavar="NAME|FILE", help=help)


def run(args: Namespace, console: Console) -> None:
    from iclnuim.labels.errors import label_errors

    found = label_errors(args.folder, args.truth, args.classes, console.progress)
    if args.csv:
        atomic_write_text(args.csv, found.csv())
    if args.plot:
        from iclnuim.labels.pictures import confusion_figure
        from iclnuim.report.charts import save

        save(confusion_figure(found), args.plot)
    values = {"folder": str(args.folder), "truth": str(args.truth), **found.to_dict()}
    for sentence in label_notes(values):
        console.note(f"note: {sentence}")
    values["warnings"] = [named(text, option_name) for text in found.warnings]
    console.result(values, labels_text(values))


def label_notes(values: dict[str, Any]) -> list[str]:
    """A sentence for everything that does not count as the reader may expect."""
    found = []
    if values["missing"]:
        total = len(values["missing"]) + values["frames"]
        found.append(
            f"{len(values['missing'])} of {total} frames have no label image and are left out: "
            f"{_listed(values['missing'])}"
        )
    if unknown := values["unknown_labels"]:
        some = [f"{name} ({count})" for name, count in unknown.items()]
        found.append(
            f"{len(unknown)} labels are not in {values['classes']} and count as no label, by "
            f"their pixels: {_listed(some)}"
        )
    if without := values["unmapped_classes"]:
        some = [f"{name} ({count})" for name, count in without.items()]
        found.append(
            f"true classes that {values['classes']} does not have do not count, by their pixels: "
            f"{_listed(some)}"
        )
    return found


def _listed(names: list[str]) -> str:
    return ", ".join(names[:_NAMED]) + (" ..." if len(names) > _NAMED else "")


def labels_text(values: dict[str, Any]) -> str:
    """The figures as a table."""
    lines = []
    for name, title in _TITLES.items():
        if name in values:
            lines.append(f"{title:<24}{_percent(values[name])}")
    count = len(values["per_class"]) + len(values["rare"])
    lines.append(f"over {count} classes of the truth ({values['classes']}), in percent")
    first = [*values["per_class"], *values["rare"]][0]
    columns = {key: title for key, title in _COLUMNS.items() if key in first}
    lines.append(f"{'class':<24}" + "".join(f"{title:>9}" for title in columns.values()))
    lines += [_row(row, columns) for row in values["per_class"]]
    if values["rare"]:
        lines.append("classes with less than 0.1 % of the true pixels:")
        lines += [_row(row, columns) for row in values["rare"]]
    lines += [f"warning: {text}" for text in values["warnings"]]
    return "\n".join(lines)


def _row(row: dict[str, Any], columns: dict[str, str]) -> str:
    name = f"{row['id']} {row['class']}"
    return f"{name:<24}" + "".join(_percent(row[key]) for key in columns)


def _percent(share: float | None) -> str:
    """`None` and NaN are figures that do not exist."""
    if share is None or share != share:
        return f"{'-':>9}"
    return f"{100 * share:>9.3f}"
