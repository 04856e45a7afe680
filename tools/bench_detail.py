"""`iclnuim bench detail`: measures the benefit and cost of more triangles and texels, and their
share that is never seen.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from pathlib import Path

from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError, blender_missing
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless.options import Actions, action, numbers
from iclnuim.native_output import native_output_in


def configure(actions: Actions) -> None:
    help = "triangles and texels against depth error, colour error and times; their share that no trajectory sees"
    detail = action(actions, "detail", help, "iclnuim bench detail --plot detail.png", _detail)
    detail.add_argument("rooms", nargs="*", metavar="ROOM", help="default: living_room office")
    detail.add_argument(
        "--levels", type=_numbers, default=(0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0), metavar="D,D",
        help="levels of detail, for depth, colour, build and frame time; default: 0.25,0.35,0.5,0.7,1,1.4,2",
    )  # fmt: skip
    detail.add_argument(
        "--lit", type=_numbers, default=(0.25, 0.5, 1.0, 2.0), metavar="D,D",
        help="levels with baked light, for the time of the bake; default: 0.25,0.5,1,2; `none`: no light",
    )  # fmt: skip
    detail.add_argument(
        "--maps", type=_numbers, default=(512, 1024, 1536, 2048), metavar="N,N",
        help="sizes of light maps in texels; default: 512,1024,1536,2048; `none`: leave them out",
    )  # fmt: skip
    help = "light map size of the lit levels; default: 1024"
    detail.add_argument("--map-size", type=int, default=1024, metavar="N", help=help)
    help = "light map samples of the lit levels; default: 2"
    detail.add_argument("--map-samples", type=int, default=2, metavar="N", help=help)
    help = "number of views, spread over all trajectories; default: 12"
    detail.add_argument("--views", type=int, default=12, metavar="N", help=help)
    help = "for visibility, use every Nth pose; default: 30"
    detail.add_argument("--every", type=int, default=30, metavar="N", help=help)
    detail.add_argument("--camera", default="320x240", metavar="WxH", help="default: 320x240")
    detail.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw the results (.png, .pdf, .svg)"
    )


def _numbers(text: str) -> tuple[float, ...]:
    return () if text == "none" else numbers(text)


def _detail(args: argparse.Namespace, console: Console) -> int:
    rooms = args.rooms or list(shipped.SCENE_NAMES)
    for room in rooms:
        if room not in shipped.SCENE_NAMES:
            raise InputError(f"rooms among {', '.join(shipped.SCENE_NAMES)}", found=room)
    if len(args.levels) < 3 or not all(0.15 <= d <= 4 for d in (*args.levels, *args.lit)):
        raise InputError("at least three levels, all within 0.15..4", found=args.levels)
    if args.views < 2 or args.every < 1:
        raise InputError(
            "--views of at least 2, --every of at least 1", found=f"{args.views}, {args.every}"
        )
    try:
        with native_output_in(Path(os.devnull)):  # even the import of bpy may print
            import bpy  # noqa: F401
        import embreex  # noqa: F401
    except ImportError as error:
        raise blender_missing("bench detail", error) from None
    return _measure(rooms, args, PinholeCamera.parse(args.camera), console)


def _measure(
    rooms: list[str], args: argparse.Namespace, camera: PinholeCamera, console: Console
) -> int:
    from iclnuim.report import charts as plots

    from . import detail, detail_chart, detail_maps, detail_unseen

    steps = len(rooms) * (len({*args.levels, *args.lit}) + len(args.maps) + 1)
    progress = console.progress(steps, "bench detail", "steps")
    levels, maps, unseen = {}, {}, []
    for room in rooms:
        levels[room] = detail.measure_levels(
            room, args.levels, args.lit, args.views, camera, args.map_size, args.map_samples, console.note, progress.advance
        )  # fmt: skip
        sizes = [int(n) for n in args.maps]
        maps[room] = detail_maps.measure_sizes(
            room, sizes, args.views, camera, 32, console.note, progress.advance
        )
        light = maps[room][-1].folder if maps[room] else None
        unseen.append(detail_unseen.measure(room, args.every, camera, light, lambda: None))
        progress.advance()
    if args.plot:
        plots.save(detail_chart.figure(levels, maps), args.plot)
    parts = [f"{r}\n{detail_chart.table(levels[r])}" for r in rooms]
    parts += [f"{r}\n{detail_chart.maps_table(maps[r])}" for r in rooms if maps[r]]
    values = {
        "levels": {r: [asdict(level) for level in levels[r]] for r in rooms},
        "knee": {r: levels[r][detail_chart.knee_of(levels[r])].detail for r in rooms},
        "maps": {r: [{**asdict(m), "folder": m.folder.name} for m in maps[r]] for r in rooms},
        "unseen": [asdict(share) for share in unseen],
    }
    console.result(values, "\n\n".join([*parts, "\n".join(map(detail_chart.unseen_line, unseen))]))
    return 0
