"""`iclnuim bench detail`: measures the benefit and cost of more triangles and texels, and their
share that is never seen.
"""

import os
import tempfile
from argparse import Namespace
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError, blender_missing
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless.options import Actions, action, add_plot, numbers
from iclnuim.native_output import native_output_in

from .measured_tables import tables

if TYPE_CHECKING:
    from .detail import DetailLevel
    from .detail_maps import MapSize
    from .detail_unseen import Unseen


def configure(actions: Actions) -> None:
    help = (
        "triangles and texels against depth error, colour error and times; "
        "their share that no trajectory sees"
    )
    detail = action(actions, "detail", help, "iclnuim bench detail --plot detail.png", _detail)
    add = detail.add_argument
    add("rooms", nargs="*", metavar="ROOM", help="default: living_room office")
    help = (
        "levels of detail, for depth, colour, build and frame time; "
        "default: 0.25,0.35,0.5,0.7,1,1.4,2"
    )
    levels = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
    add("--levels", type=_numbers, default=levels, metavar="D,D", help=help)
    help = (
        "levels with baked light, for the time of the bake; default: 0.25,0.5,1,2; `none`: no light"
    )
    add("--lit", type=_numbers, default=(0.25, 0.5, 1.0, 2.0), metavar="D,D", help=help)
    help = "sizes of light maps in texels; default: 512,1024,1536,2048; `none`: leave them out"
    add("--maps", type=_numbers, default=(512, 1024, 1536, 2048), metavar="N,N", help=help)
    help = "number of views, spread over all trajectories; default: 12"
    add("--views", type=int, default=12, metavar="N", help=help)
    help = "for visibility, use every Nth pose; default: 30"
    add("--every", type=int, default=30, metavar="N", help=help)
    add("--camera", default="320x240", metavar="WxH", help="default: 320x240")
    add_plot(detail)


def _numbers(text: str) -> tuple[float, ...]:
    if text == "none":
        return ()
    return numbers(text)


def _detail(args: Namespace, console: Console) -> None:
    rooms = args.rooms or list(shipped.SCENE_NAMES)
    for room in rooms:
        if room not in shipped.SCENE_NAMES:
            raise InputError(f"rooms among {', '.join(shipped.SCENE_NAMES)}", found=room)
    if len(args.levels) < 3 or not all(0.15 <= d <= 4 for d in (*args.levels, *args.lit)):
        raise InputError("at least three levels, all within 0.15..4", found=args.levels)
    if args.views < 2 or args.every < 1:
        expected = "--views of at least 2, --every of at least 1"
        raise InputError(expected, found=f"{args.views}, {args.every}")
    try:
        with native_output_in(Path(os.devnull)):  # even the import of bpy may print
            import bpy  # noqa: F401
        import embreex  # noqa: F401
    except ImportError as error:
        raise blender_missing("bench detail", error) from None
    _measure(rooms, args, PinholeCamera.parse(args.camera), console)


def _measure(rooms: list[str], args: Namespace, camera: PinholeCamera, console: Console) -> None:
    from iclnuim.report import charts

    from . import detail, detail_chart, detail_maps, detail_unseen

    steps = len(rooms) * (len({*args.levels, *args.lit}) + len(args.maps) + 1)
    progress = console.progress(steps, "bench detail", "steps")
    levels = {}
    maps = {}
    unseen = []

    def on_level(level: detail.DetailLevel) -> None:
        console.note(str(level))
        progress.advance()

    for name in rooms:
        with tempfile.TemporaryDirectory() as folder:
            room = detail.Room(name, detail.views_of(name, args.views), camera, Path(folder))
            levels[name] = detail.measure_levels(room, args.levels, args.lit, on_level)
        sizes = [int(n) for n in args.maps]
        maps[name] = detail_maps.measure_sizes(
            name, sizes, args.views, camera, console.note, progress.advance
        )
        largest = maps[name][-1].folder if maps[name] else None
        unseen.append(detail_unseen.measure(name, args.every, camera, largest))
        progress.advance()
    if args.plot:
        charts.save(detail_chart.figure(levels, maps), args.plot)
    _report(levels, maps, unseen, console)


def _report(
    levels: "dict[str, list[DetailLevel]]",
    maps: "dict[str, list[MapSize]]",
    unseen: "list[Unseen]",
    console: Console,
) -> None:
    from . import detail_chart

    knee = {name: row[detail_chart.knee_of(row)].detail for name, row in levels.items()}
    values = {
        "levels": {name: [asdict(level) for level in row] for name, row in levels.items()},
        "knee": knee,
        "maps": {name: [_map_values(one) for one in row] for name, row in maps.items()},
        "unseen": [asdict(share) for share in unseen],
    }
    rooms = [f"detail-{name.replace('_', '-')}" for name in levels]
    console.result(values, tables(values, *rooms, "detail-maps", "detail-unseen"))


def _map_values(one: "MapSize") -> dict[str, Any]:
    return {**asdict(one), "folder": one.folder.name}
