"""`iclnuim bench noise`: speed of the noise models, and their similarity to published frames."""

from argparse import Namespace
from dataclasses import asdict
from pathlib import Path

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.headless.options import Actions, action, add_plot

from .measured_tables import tables


def configure(actions: Actions) -> None:
    help = (
        "speed of the noise models next to that of file input and output alone; "
        "similarity to published noisy frames"
    )
    example = "iclnuim bench noise out/living_room/kt2/raw --official or_kt3 --plot noise.png"
    noise = action(actions, "noise", help, example, _noise)
    add = noise.add_argument
    add("raw", type=Path, metavar="RAW", help="folder of a run, as `iclnuim render` writes it")
    add("--frames", default=":40", metavar="A:B:S", help="default: the first 40")
    help = "number of repetitions, of which the median is reported; default: 5"
    add("--rounds", type=int, default=5, metavar="N", help=help)
    add("--workers", type=int, default=4, metavar="N", help="number of processes; default: 4")
    help = "folder with clean/ and noisy/ of the same frames, such as those of the original dataset"
    add("--official", type=Path, metavar="DIR", help=help)
    add_plot(noise, "time and similarity of the models")


def _noise(args: Namespace, console: Console) -> None:
    from iclnuim.report import charts

    from . import noise_comparison

    if args.rounds < 1 or args.workers < 1:
        raise InputError("rounds and workers of at least 1", found=min(args.rounds, args.workers))
    overlaps = None
    if args.official:
        overlaps = noise_comparison.overlaps(args.official / "clean", args.official / "noisy")
    times_ms = noise_comparison.model_times_ms(args.raw, args.frames)
    rounds = args.rounds * len(noise_comparison.PAIRS)
    progress = console.progress(rounds, "bench noise", "rounds")
    pairs = noise_comparison.pair_times(
        args.raw, args.frames, args.rounds, args.workers, progress.advance
    )
    if args.plot:
        charts.save(noise_comparison.figure(pairs, times_ms, overlaps), args.plot)
    values = {
        "pairs": [asdict(p) for p in pairs],
        "model_ms": times_ms,
        "overlap_with_official": overlaps,
    }
    console.result(values, tables(values, "noise-pairs", "noise-models"))
