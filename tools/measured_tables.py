"""The tables of docs/measured that come from the output of commands of iclnuim: what is measured by
which commands, and the rows that it becomes.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, compress, product
from statistics import geometric_mean, mean, median
from string import Formatter
from typing import Any

from iclnuim.benchmark.experiments.recipes.inertial import succeeded
from iclnuim.benchmark.perturbations.plan import Bounds

_PICTURES = "docs/measured/pictures"
_KT2 = "out/living_room/kt2"
_SEQUENCES = [f"{room}/kt{k}" for room, k in product(("living_room", "office"), range(4))]
_BIASED = ("icp", "rgbd", "icp_rgbd")
_FOUR = f"{_KT2}/clean {_KT2}/noisy out/office/kt1/clean out/office/kt1/noisy"
#: Curve -> the step to which the table refers: the default, or one at which all methods work.
_CURVES = {"iterations": 1.0, "levels": 0.0, "pixels": 1.0, "resolution": 640.0}
_NOISE = (
    "bench noise out/office/kt0/raw --frames 600:620 --rounds 3 --workers 2 "
    "--official ../shared/data/iclnuim/or_kt3"
)
_SENSORS = (
    "experiment sensors out/office/kt0/clean --frames :150 --workers 1 --set "
    "methods=icp,rgbd,icp_rgbd,dvo,fovis,opencv-rgbd,opencv-rgbd-icp"
)
#: Sequences of `make --imu bmi055`.
_INERTIAL = (
    f"run orbslam3 {' '.join(f'out/{name}/clean' for name in _SEQUENCES)} --frames :600 --runs 3 "
    "--program slam/bin/python --vocabulary ORBvoc.txt"
)
#: Second at which images begin to fail, before and after ORB-SLAM3 has settled its IMU; sequences;
#: options.
_FAILING = (
    (
        15,
        "out/living_room/kt1/noisy out/living_room/kt2/noisy out/office/kt2/noisy",
        "-o out/inertial",
    ),
    (
        20,
        "out/living_room/kt2/noisy out/office/kt2/noisy",
        "--set whole_s=20 --set kinds=black,frozen -o out/inertial_late",
    ),
)
#: Title of the row, kind of sequence, options of `fuse`.
_SURFACES = (
    ("clean, `best`", "clean", ""),
    ("clean, `--preset paper`", "clean", "--preset paper"),
    ("noisy (`released`), `best --min-weight 3`", "noisy", "--min-weight 3"),
)
#: The words of each row of a table, the header first.
Rows = list[list[str]]
#: The rows of a table from the output of each of its commands.
FromOutput = Callable[[Sequence[Any]], Rows]


@dataclass(frozen=True)
class CommandTable:
    """One table: its mark, the commands (words after `iclnuim`; --json is added), and the function
    that makes the rows from their output.
    """

    mark: str
    commands: tuple[str, ...]
    rows: FromOutput


def words(header: str, rows: Iterable[Sequence[object]]) -> Rows:
    """The rows of a table as texts. header: the columns, with "|" between them."""
    columns = [name.strip() for name in header.split("|")]
    return [columns, *([str(one) for one in row] for row in rows)]


class _Figures(Formatter):
    """Formats figures by `digits unit`: metres in mm; empty if one was not measured."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if value is None:
            return ""
        digits, space, unit = format_spec.partition(" ")
        if unit == "mm":
            value = 1e3 * value
        return f"{value:{digits}}{space}{unit}"


def _each(header: str, row: str, figures: Iterable[Mapping[str, Any]]) -> Rows:
    """A row of each mapping: fields between "|", with its figures by name."""
    texts = [field.strip() for field in row.split("|")]
    return words(header, ([_Figures().vformat(text, (), one) for text in texts] for one in figures))


def _plain(sequence: str) -> str:
    return sequence.replace("_", " ").replace("/", " ")


def _mm(run: dict[str, Any]) -> str:
    """The ATE of a run in mm."""
    ate_m = run["ate_rmse_m"]
    if ate_m is None:
        return "-"
    digits = 3 if ate_m < 1 else 4
    return f"{1e3 * ate_m:.{digits}g}"


def _light(found: Sequence[Any]) -> Rows:
    header = (
        "light | samples | s/frame | PSNR dB | worst view | median error"
        " | median change from frame to frame (of 255)"
    )
    row = (
        "{method[family]} | {method[label]} | {seconds:.3g} | {mean_db:.1f} | {worst_db:.1f}"
        " | {error[median]:.4f} | {of_255:.2f}"
    )
    figures = []
    for one in found[0]["methods"]:
        psnr_db = one["error"]["psnr_db"]
        ours = {"mean_db": mean(psnr_db), "worst_db": min(psnr_db), "of_255": 255 * one["flicker"]}
        figures.append(one | ours)
    return _each(header, row, figures)


def _textures(found: Sequence[Any]) -> Rows:
    header = (
        "sequence | textures | median change | mean change | mean difference from 16 rays a pixel"
    )
    row = "{sequence} | {textures} | {change_median:.2f} | {change_mean:.2f} | {difference:.2f}"
    figures = []
    for r in found[0]["rows"]:
        names = ("change_median", "change_mean", "difference")
        of_255 = {name: r[name] and 255 * r[name] for name in names}
        figures.append({**r, **of_255, "sequence": _plain(r["sequence"])})
    return _each(header, row, figures)


def _splits(found: Sequence[Any]) -> Rows:
    """One row for each split of the cores."""
    rows: dict[str, dict[str, tuple[str, str]]] = {}
    for one in found[0]["splits"]:
        split = f"{one['workers']} x {one['threads']}"
        figures = (f"{one['frames_an_hour']:,.0f}", f"{one['busy_share']:.0%}")
        rows.setdefault(split, {})[one["light"]] = figures
    header = (
        "workers x threads | baked, frames an hour | cores busy"
        " | path traced, frames an hour | cores busy"
    )
    none = ("", "")
    return words(
        header,
        [(split, *of.get("baked", none), *of.get("path", none)) for split, of in rows.items()],
    )


def _chaos(found: Sequence[Any]) -> Rows:
    header = (
        " | frames | kill -9 | full disk | stopped worker | frames broken | frames lost"
        " | finished twice"
    )
    row = "{name} | {frames} | {kills} | {full} | {stop} | {broken} | {lost} | {twice}"
    figures = []
    for name, damage in found[0].items():
        events = {"full": None, "stop": None, **damage["events"]}
        figures.append({"name": name, **damage, **events})
    return _each(header, row, figures)


def _pairs(found: Sequence[Any]) -> Rows:
    header = "depth + RGB | processor ms a frame | over files alone"
    row = "{depth} + {rgb} | {cpu_ms:.0f} | {cpu_ratio:.2f}"
    return _each(header, row, found[0]["pairs"])


def _models(found: Sequence[Any]) -> Rows:
    overlaps = found[0]["overlap_with_official"] or {}
    figures = []
    for kind, times_ms in found[0]["model_ms"].items():
        for name, ms in times_ms.items():
            overlap = overlaps.get(kind, {}).get(name)
            figures.append({"kind": kind, "name": name, "ms": ms, "overlap": overlap})
    header = "model | ms a frame, one core | overlap with the official noise"
    return _each(header, "{kind} `{name}` | {ms:.1f} | {overlap:.3f}", figures)


def _surface(titles: Iterable[str]) -> FromOutput:
    """One row per surface, from the output of `fuse` and `evaluate surface` alternately."""

    def text(found: Sequence[Any]) -> Rows:
        rows = []
        for title, made, error in zip(titles, found[::2], found[1::2], strict=True):
            distance_m = error["distance_m"]
            statistics = [distance_m[key] for key in ("mean", "median", "std", "min", "max")]
            distances = [f"{1e3 * value:.3g}" for value in statistics]
            rows.append(
                (title, *distances, f"{made['memory_mb']:.0f} MB", made["parts_out_of_window"])
            )
        header = "kt2, ours | mean | median | std | min | max | memory | parts that left the window"
        return words(header, rows)

    return text


def _offsets(odometers: Sequence[str], sequences: Sequence[str]) -> FromOutput:
    """ATE in mm, from the runs of each odometer on one sequence after the other."""

    def text(found: Sequence[Any]) -> Rows:
        values = [_mm(one["runs"][0]) for one in found]
        rows = []
        for k, name in enumerate(odometers):
            rows.append((f"`{name}`", *values[k :: len(odometers)]))
        return words("|".join(["noisy", *map(_plain, sequences)]), rows)

    return text


def _curve(default: float) -> FromOutput:
    """Error and time of each step divided by those of the default step; geometric means over the
    sequences.
    """

    def text(found: Sequence[Any]) -> Rows:
        # method -> sequence -> step; a method without the setting has one point, without a value
        steps: dict[str, dict[str, dict[float, Any]]] = {}
        values: dict[float, None] = {}
        for point in found[0]["points"]:
            if point["value"] is not None:
                values[point["value"]] = None
                of_method = steps.setdefault(point["method"], {})
                of_method.setdefault(point["sequence"], {})[point["value"]] = point
        rows = []
        for value in values:
            cells = [_step(of_method, value, default) for of_method in steps.values()]
            rows.append((f"{value:g}", *cells))
        return words("|".join(["", *steps]), rows)

    return text


def _step(of_method: dict[str, dict[float, Any]], value: float, default: float) -> str:
    """A cell of the table of a curve, from the steps of one method on each sequence."""
    points = [of[value] for of in of_method.values() if value in of]
    bases = [of[default] for of in of_method.values() if value in of]
    if not points:
        return "-"
    if lost := sum(p["ate_m"] is None or 2 * p["tracked"] < p["processed"] for p in points):
        return f"fails on {lost}"
    error = _ratio(points, bases, "ate_m")
    time = _ratio(points, bases, "ms")
    text = f"{error:.2f}, {time:.2f}"
    share = mean(p["processed"] / p["frames"] for p in points)
    if share > 0.995:
        return text
    return f"{text} ({share:.0%})"


def _ratio(points: Sequence[Any], bases: Sequence[Any], key: str) -> float:
    return geometric_mean(p[key] / base[key] for p, base in zip(points, bases, strict=True))


def _voxels(found: Sequence[Any]) -> Rows:
    header = " | voxel | mean distance | 95 % | ms per frame | MB"
    row = (
        "{sequence} | {voxel_m:.3g mm} | {mean_m:.3g mm} | {p95_m:.3g mm} | {ms:.0f}"
        " | {memory_mb:.0f}"
    )
    return _each(header, row, found[0]["points"])


def _sensors(found: Sequence[Any]) -> Rows:
    """A row a sensor: pixels without depth, and the ATE of each method."""
    cells = found[0]["cells"]
    methods = list(cells[0]["ate_m"])
    rows = []
    for one in cells:
        runs = ({"ate_rmse_m": one["ate_m"][name]} for name in methods)
        rows.append([one["variant"], f"{one['missing_share']:.1%}", *map(_mm, runs)])
    return words(" | ".join(["sensor", "missing", *methods]), rows)


def _inertial(found: Sequence[Any]) -> Rows:
    """A row a sequence: ATE of ORB-SLAM3's runs without and with the IMU that keep track of most
    frames, over all frames and after the start, and its initialisation.
    """
    header = (
        "sequence | RGB-D, ATE mm | with the IMU | ratio of medians | RGB-D from 5 s on, ATE mm"
        " | with the IMU | ratio of medians | IMU initialised after | runs that keep track"
    )
    rows = []
    for results in zip(*(one["results"] for one in found), strict=True):
        finals = [one["runs"][0] for one in results]
        runs = [final["each"] for final in finals]
        ates_m = [[r["ate_rmse_m"] for r in _tracked(final)] for final in finals]
        whole, from_5_s = _compared(*ates_m[:2]), _compared(*ates_m[2:])
        times_s = [r["initialised_s"] for r in runs[1] if r["initialised_s"] is not None]
        initialised = f"{_spread(times_s, '.1f')} s, {len(times_s)} of {len(runs[1])} runs"
        counts = " and ".join(
            f"{len(ates)} of {len(each)}" for ates, each in zip(ates_m[:2], runs[:2], strict=True)
        )
        rows.append((_plain(results[0]["sequence"]), *whole, *from_5_s, initialised, counts))
    return words(header, rows)


def _compared(without_m: Sequence[float], with_imu_m: Sequence[float]) -> list[str]:
    """Both errors in mm, and the ratio of their medians."""
    both = without_m and with_imu_m
    ratio = f"{median(with_imu_m) / median(without_m):.2f}" if both else "-"
    in_mm = ([1e3 * ate_m for ate_m in each] for each in (without_m, with_imu_m))
    return [*(_spread(each, ".3g") for each in in_mm), ratio]


def _failing(found: Sequence[Any]) -> Rows:
    """A row for each time, sequence and kind of failure: runs of ORB-SLAM3 within the bounds of
    `iclnuim stress`, their median ATE, and the frames with a pose.
    """
    runs: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for (starts_s, *_), one in zip(_FAILING, found, strict=True):
        for cell in one["cells"]:
            kind, mode = cell["variant"].split("/")
            row = (f"{starts_s} s", _plain(cell["sequence"]), kind)
            runs.setdefault(row, {})[mode] = _good(cell)
    header = (
        "failing from | sequence | images | RGB-D: good runs | ATE mm | frames with a pose"
        " | with the IMU: good runs | ATE mm | frames with a pose"
    )
    modes = dict.fromkeys(chain(*runs.values()))
    return words(header, ([*row, *chain(*(runs[row][m] for m in modes))] for row in sorted(runs)))


def _good(cell: Mapping[str, Any]) -> list[str]:
    """How many runs of a cell are within the bounds, the median of their errors, and the median
    share of frames with a pose of all runs.
    """
    good_m = list(compress(cell["ate_m"], succeeded(cell)))
    ate = f"{1e3 * median(good_m):.3g}" if good_m else "-"
    return [f"{len(good_m)} of {len(cell['ate_m'])}", ate, f"{median(cell['coverage']):.0%}"]


def _tracked(final: Any) -> list[Any]:
    """The runs with an ATE of at least the share of frames that `iclnuim stress` asks for."""
    fewest = Bounds().min_coverage * final["frames"]
    return [r for r in final["each"] if r["ate_rmse_m"] is not None and r["matched"] >= fewest]


def _spread(values: Sequence[float], digits: str) -> str:
    """The median, with the smallest and the largest."""
    if not values:
        return "-"
    return f"{median(values):{digits}} ({min(values):{digits}} to {max(values):{digits}})"


def _plotted(command: str, picture: str) -> str:
    return f"{command} --plot {_PICTURES}/{picture}"


def _surface_commands() -> Iterator[str]:
    for k, (_, kind, options) in enumerate(_SURFACES):
        mesh = f"out/measured-{k}.ply"
        poses = f"{_KT2}/clean/groundtruth.txt"
        fuse = " ".join(f"fuse {_KT2}/{kind} --poses {poses} {options} -o {mesh}".split())
        evaluate = f"evaluate surface {mesh} --model living_room"
        if k == 0:
            fuse = f"{fuse} --plot docs/pictures/surface.jpg"
            evaluate = _plotted(evaluate, "surface_error.png")
        yield fuse
        yield evaluate


def _command_tables() -> Iterator[CommandTable]:
    yield CommandTable("light", (_plotted("bench render kt2", "light.png"),), _light)
    textures = _plotted("bench textures kt2 office/kt0", "textures.png")
    yield CommandTable("textures", (textures,), _textures)
    offsets = []
    for sequence, name in product(_SEQUENCES, _BIASED):
        offsets.append(f"odometry {name} out/{sequence}/noisy --depth-offset 0.00155")
    titles = [sequence.removeprefix("living_room/") for sequence in _SEQUENCES]
    yield CommandTable("odometry-bias", tuple(offsets), _offsets(_BIASED, titles))
    yield CommandTable("farm-splits", (_plotted("bench farm kt2", "farm.png"),), _splits)
    chaos = _plotted("bench chaos kt2 --camera 160x120", "chaos.png")
    yield CommandTable("farm-chaos", (chaos,), _chaos)
    noise = (_plotted(_NOISE, "noise.png"),)
    yield CommandTable("noise-pairs", noise, _pairs)
    yield CommandTable("noise-models", noise, _models)
    yield CommandTable("sensor-odometry", (_SENSORS,), _sensors)
    modes = (_INERTIAL, f"{_INERTIAL} --mode rgbd-inertial")
    later = (f"{mode} --skip 5" for mode in modes)  # the same runs, evaluated again
    yield CommandTable("systems-inertial", (*modes, *later), _inertial)
    options = "--frames :840 --workers 1 --set vocabulary=ORBvoc.txt --set program=slam/bin/python"
    failing = tuple(
        f"experiment inertial {sequences} {options} --set runs=3 {further}"
        for _, sequences, further in _FAILING
    )
    yield CommandTable("systems-failing", failing, _failing)
    titles = [title for title, _, _ in _SURFACES]
    yield CommandTable("surface-error", tuple(_surface_commands()), _surface(titles))
    for curve, default in _CURVES.items():
        command = f"bench curve {curve} {_FOUR} --method all --frames 80:200"
        table = (_plotted(command, f"curve_{curve}.png"),)
        yield CommandTable(f"curve-{curve}", table, _curve(default))
    voxel = f"bench curve voxel {_KT2}/clean {_KT2}/noisy --frames 80:320"
    yield CommandTable("curve-voxel", (_plotted(voxel, "curve_voxel.png"),), _voxels)


COMMAND_TABLES = {table.mark: table for table in _command_tables()}


def markdown(rows: Rows) -> str:
    """A table in Markdown; its first row is the header."""
    lines = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def tables(output: Any, *marks: str) -> str:
    """The tables of some marks from the output of their one command, in Markdown."""
    return "\n".join(markdown(COMMAND_TABLES[mark].rows([output])) for mark in marks).rstrip()
