"""The 18 findings of the paper's section VI with their verdicts: the rules applied to the printed
figures, to those of each preset of ours, and to those of the authors' programs; a finding about
noisy frames is decided by each noise seed whose cells are measured.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...cell import Measured
from ...table import NOT_MEASURED, ResultTable
from .claims import TOLERANCE, MissingFigure
from .figures import AUTHORS, Ours, PaperFigures, Printed, paper, seeds_of
from .rules import RULES, Void

HOLDS = "holds"
FAILS = "does not hold"
CLOSE = "undecided"
UNDECIDED = "undecided by the seeds"
VOID = "void"
MISSING = NOT_MEASURED
#: Those about noisy frames: each noise seed decides them.
NOISY = range(12, 19)


_PLURAL = {HOLDS: "hold", FAILS: "do not hold"}
#: The methods of a table of verdicts: name of the column -> the cells, but for their seed.
_METHODS: dict[str, dict[str, Any]] = {
    "paper": {"preset": "paper"},
    "paper, window ahead": {"preset": "paper", "model": "model-ahead"},
    "paper, authors' programs": {"preset": "paper", "programs": AUTHORS},
    "best": {"preset": "best"},
}


@dataclass(frozen=True)
class Verdict:
    """What the cells say of a finding. seeds: `3 of 4` noise seeds with which it holds, or a dash.
    figures, cause: of the first seed that decides it.
    """

    word: str
    seeds: str = "-"
    figures: str = ""
    cause: str = ""


def findings_table(results: Sequence[Measured], preset: str = "best") -> ResultTable:
    """One row per finding that the cells decide: the printed figures, ours, the verdict, its cause,
    and the rule, with a remark on the printed figures. A note has the numbers of the others.
    """
    rows = []
    missing = []
    views = views_of(results, preset)
    for finding in paper()["findings"]:
        number = finding["number"]
        ours = verdict_of(views, number)
        if ours.word == MISSING:
            missing.append(str(number))
            continue
        found = (ours.figures or "-", ours.word, ours.seeds, ours.cause or "-")
        words = (str(number), finding["section"], finding["finding"], _printed_text(number))
        rows.append((*words, *found, _rule(finding)))
    columns = ("no.", "section", "finding", "printed", "ours", "verdict", "seeds", "cause", "rule")
    title = "The findings of section VI, decided by rules over the cells."
    notes = [
        "The verdicts apply to these cells only: frames, noise and odometers are ours, not the "
        f"paper's. Errors in mm; figures that differ by less than {TOLERANCE:.0%} decide nothing.",
        "Cause: the comparison on which the verdict turned, of two methods on the same frames, of "
        "two sequences of the rooms, or of frames without noise and with it.",
    ]
    if missing:
        which = f"Findings {', '.join(missing)}" if rows else "All findings"
        notes.append(f"{which} need more cells than these {len(results)}, which fill the tables.")
    table = ResultTable("findings", title, columns, tuple(rows), notes=tuple(notes))
    return table.of_preset(preset)


def _rule(finding: Mapping[str, Any]) -> str:
    """Its rule in words, with the remark on what the paper says or prints."""
    why = RULES[finding["number"]].why
    return f"{why}. {finding['remark']}" if "remark" in finding else why


def _printed_text(number: int) -> str:
    """The printed figures, and what the rule says of them where they do not bear it out."""
    try:
        answer = RULES[number].answer(Printed())
    except MissingFigure as missing:
        return missing.figures or "-"
    if answer.holds is None:
        return f"{answer.figures}; by this rule, the printed figures decide nothing"
    if not answer.holds:
        return f"{answer.figures}; by this rule, the printed figures contradict the finding"
    return answer.figures


def verdicts_by_method(results: Sequence[Measured]) -> dict[str, list[Verdict]]:
    """The verdicts of all findings in their order: of the printed figures, of the preset `paper`,
    of it with the model's window before the camera, of it with the authors' programs of FOVIS and
    DVO in their place, and of `best`.
    """
    views: dict[str, Sequence[PaperFigures]] = {"printed": [Printed()]}
    for name, cells in _METHODS.items():
        seeds = [0] if "programs" in cells else seeds_of(results, cells["preset"])
        views[name] = [Ours(results, seed=seed, **cells) for seed in seeds]
    return {name: [verdict_of(some, k) for k in RULES] for name, some in views.items()}


def verdicts_table(results: Sequence[Measured]) -> ResultTable:
    """One row per finding: its rule with a remark, and the verdict of each method."""
    found = verdicts_by_method(results)
    rows = []
    for k, finding in enumerate(paper()["findings"]):
        words = [_with_seeds(of[k]) for of in found.values()]
        words[0] = words[0].replace(MISSING, "not printed")
        rows.append((str(finding["number"]), finding["finding"], _rule(finding), *words))
    columns = ("no.", "finding", "rule", *found)
    title = "The findings of section VI, by the paper's methods and by ours."
    return ResultTable("verdicts", title, columns, tuple(rows), notes=tuple(headline(results)))


def _with_seeds(of: Verdict) -> str:
    """The verdict, and with how many seeds a finding holds that some of them contradict."""
    return f"{of.word} ({of.seeds})" if of.word == UNDECIDED else of.word


def headline(results: Sequence[Measured]) -> list[str]:
    """A sentence for each method: how many of the findings hold with it."""
    sentences = []
    for name, verdicts in list(verdicts_by_method(results).items())[1:]:
        counts = Counter(of.word for of in verdicts)
        words = (HOLDS, FAILS, CLOSE, UNDECIDED, VOID, MISSING)
        shown = [_counted(counts[word], word) for word in words if counts[word]]
        sentences.append(f"With {name}, of {len(verdicts)} findings {', '.join(shown)}.")
    return sentences


def _counted(count: int, word: str) -> str:
    return f"{count} {word if count == 1 else _PLURAL.get(word, word)}"


def views_of(results: Sequence[Measured], preset: str) -> list[Ours]:
    """The cells of a preset, seed by seed."""
    return [Ours(results, preset, seed) for seed in seeds_of(results, preset)]


def verdict_of(views: Sequence[PaperFigures], number: int) -> Verdict:
    """The verdict of a finding's rule on figures; if it is about noise, on those of each seed."""
    answers = []
    for view in views if number in NOISY else views[:1]:
        try:
            answers.append(RULES[number].answer(view))
        except MissingFigure:
            continue
        except Void as void:
            return Verdict(VOID, cause=str(void))
    if not answers:
        return Verdict(MISSING)
    found = [answer.holds for answer in answers]
    seeds = f"{found.count(True)} of {len(found)}" if number in NOISY else "-"
    return Verdict(verdict(found), seeds, answers[0].figures, answers[0].cause)


def verdict(holds: Iterable[bool | None]) -> str:
    """The verdict from a rule's answers for the noise seeds; at least one."""
    answers = set(holds)
    if len(answers) > 1:
        return UNDECIDED
    return {True: HOLDS, False: FAILS, None: CLOSE}[answers.pop()]
