"""Writes the figures that pages take from committed archives: `make figures`.

A page has them between `<!-- figures: renderers WORDS -->` and `<!-- end -->`, on lines of their own or within a sentence. What
stands there is made of the archive results/renderers. The words are one of:

- `first`: the fastest of each scene to each error;
- `0.01`: seconds of every contestant to this error; `0.01 brief`: of the engines of `BRIEF`, without intervals;
- `study 0.01 numba`: the seconds of one of `CONTESTANTS` to this error on this scene;
- `biased`: whose image differs from the reference, and by how much;
- `race`: machine, versions, scenes and cells.

`claims` asserts what the prose of docs/renderers.md says of them.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from math import inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple

from harness import open_results
from harness.analysis.model import bias_sizes
from harness.report.chapter.experiment import contended_cells, place
from harness.report.tables.model import estimate_text

ROOT = Path(__file__).resolve().parents[1]
MARK = re.compile(r"(<!-- figures: ([^\n]*?) -->)(\n?)(?:(?!<!-- ).)*(<!-- end -->)", re.DOTALL)


class Contestant(NamedTuple):
    """How the race names it, and how pages do."""

    engine: str
    sampler: str
    division: str
    title: str


CONTESTANTS = {
    "numba-random": Contestant("numba", "random", "closed", "numba, random"),
    "numba": Contestant("numba", "sobol", "closed", "numba, Sobol"),
    "embree": Contestant("embree", "sobol", "closed", "embree, Sobol"),
    "mitsuba-random": Contestant("mitsuba", "random", "closed", "Mitsuba, random"),
    "mitsuba": Contestant("mitsuba", "multijitter", "closed", "Mitsuba, fastest"),
    "luxcore": Contestant("luxcore", "random", "closed", "LuxCore"),
    "cycles": Contestant("cycles", "sobol", "closed", "Cycles"),
    "cycles-open": Contestant("cycles", "sobol", "open", "Cycles, light tree"),
}
BRIEF = {
    **{"numba": "numba, Sobol", "embree": "embree, Sobol", "mitsuba": "Mitsuba, fastest setting"},
    **{"luxcore": "LuxCore", "cycles": "Cycles"},
}
"""Columns of the short table, and their heads."""
PEERS = {"mitsuba": "Mitsuba", "luxcore": "LuxCore", "cycles": "Cycles"}
LETTERS = {
    **{"biased": "b", "biased_image": "b", "biased_tile": "b", "on_bias_floor": "b"},
    **{"equivalence_unresolved": "u", "too_good_per_sample": "e", "contended": ""},
}
"""Flag -> the letter behind a time. A flag without one is an error, since docs/renderers.md does not explain it."""


class Race:
    """The race of renderers, from its archive. Rows are those of the DataFrame `verdicts`."""

    def __init__(self, folder: Path) -> None:
        found = open_results(folder)
        self.analysis = found.analysis
        self.cells = found.cells
        rows = [(_key(row), row) for row in found.verdicts.fillna({"label": "", "flags": ""}).itertuples() if not row.label]
        self.rows = {(row.scene, row.target, key): row for key, row in rows}
        self.scenes = list(dict.fromkeys(row.scene for _, row in rows))
        self.targets = sorted({row.target for _, row in rows}, reverse=True)
        self.of = {(each.contestant.settings.scene, each.contestant.name): each for each in self.analysis.verdicts}

    def at(self, scene: str, target: float, key: str) -> Any:
        return self.rows[scene, target, key]

    def ranked(self, scene: str, key: str) -> bool:
        row = self.rows.get((scene, self.targets[0], key))
        return row is not None and not self.of[scene, row.contestant].disqualified

    def possible(self, scene: str, target: float) -> list[str]:
        """Those of the closed division that may be the fastest, by time."""
        keys = [key for key, one in CONTESTANTS.items() if one.division == "closed" and (scene, target, key) in self.rows]
        found = [key for key in keys if self.at(scene, target, key).possible_winner]
        return sorted(found, key=lambda key: self.at(scene, target, key).seconds)


def _key(row: Any) -> str:
    return next(
        key
        for key, one in CONTESTANTS.items()
        if (one.engine, one.division) == (row.engine, row.division) and row.sampler.startswith(one.sampler)
    )


# --- tables ----------------------------------------------------------------------------------------------------------


def renderers(race: Race, words: Sequence[str]) -> str:
    """What a page shows of the race."""
    match words:
        case ["first"]:
            return first(race)
        case ["biased"]:
            return biased(race)
        case ["race"]:
            return setting(race)
        case [target]:
            return seconds(race, float(target))
        case [target, "brief"]:
            return brief(race, float(target))
        case [scene, target, key]:
            return estimate_text(_estimate(race.at(scene, float(target), key))).replace(" [", " s [")
    raise ValueError(f"figures: renderers {' '.join(words)}: see the top of {Path(__file__).name}")


def first(race: Race) -> str:
    def cell(scene: str, target: float) -> str:
        found = race.possible(scene, target)
        names = [CONTESTANTS[key].title for key in found]
        reached = [isfinite(race.at(scene, target, key).seconds) for key in found]
        texts = [name if there else f"{name} (not reached)" for name, there in zip(names, reached, strict=True)]
        return " / ".join(texts) or "none that is ranked"

    rows = [(f"`{scene}`", *(cell(scene, target) for target in race.targets)) for scene in race.scenes]
    return _table(("scene", *(f"to {target:g}" for target in race.targets)), rows)


def seconds(race: Race, target: float) -> str:
    rows = [(f"`{scene}`", *(_cell(race, scene, target, key) for key in CONTESTANTS)) for scene in race.scenes]
    return _table(("scene", *(one.title for one in CONTESTANTS.values())), rows)


def brief(race: Race, target: float) -> str:
    """Without intervals, of which bounds stay; who is not ranked has a star."""

    def cell(scene: str, key: str) -> str:
        row = race.rows.get((scene, target, key))
        if row is None:
            return "-"
        text = estimate_text(_estimate(row)).partition(" [")[0]
        if key in race.possible(scene, target):
            return f"**{text}**"
        return text if race.ranked(scene, key) else rf"{text}\*"

    rows = [(f"`{scene}`", *(cell(scene, key) for key in BRIEF)) for scene in race.scenes]
    return _table(("scene", *BRIEF.values()), rows)


def _cell(race: Race, scene: str, target: float, key: str) -> str:
    row = race.rows.get((scene, target, key))
    if row is None:
        return "–"
    text = estimate_text(_estimate(row))
    if key in race.possible(scene, target):
        value, bracket, interval = text.partition(" [")
        text = f"**{value}**{bracket}{interval}"
    letters = "".join(sorted({LETTERS[flag] for flag in row.flags.split()}))
    return f"{text} *{letters}*" if letters else text


def _estimate(row: Any) -> tuple[float, float, float]:
    return row.seconds, row.seconds_low, row.seconds_high


def biased(race: Race) -> str:
    words = {"biased": "pixels", "biased_image": "mean", "biased_tile": "a tile"}
    rows = []
    for scene in race.scenes:
        for key, one in CONTESTANTS.items():
            row = race.rows.get((scene, race.targets[0], key))
            sizes = {} if row is None else bias_sizes(race.of[scene, row.contestant].bias)
            found = [words[flag] + size.partition(" at ")[0] for flag, size in sizes.items() if flag in row.flags.split()]
            rows += [(f"`{scene}`", one.title, ", ".join(found))] if found else []
    return _table(("scene", "contestant", "bias"), rows)


def setting(race: Race) -> str:
    cells = race.cells
    versions = cells.drop_duplicates("engine").set_index("engine").engine_version
    peers = [f"{name} {str(versions[engine]).split('+')[1]}" for engine, name in PEERS.items() if engine in versions]
    one = cells.drop_duplicates("scene").set_index("scene")
    scenes = [
        f"`{scene}` ({one.primitives[scene]:,} primitives, {one.width[scene]}x{one.height[scene]})" for scene in race.scenes
    ]
    blocks = cells.block.nunique()
    threads = " or ".join(map(str, sorted(cells.threads.unique())))
    rows = [
        ("machine", place(race.analysis)[0].removeprefix("The machine was ").rstrip(".")),
        ("renderers", "; ".join(["raybench's numba and embree", *peers])),
        ("scenes", ", ".join(scenes)),
        ("threads, precision", f"{threads}, {' or '.join(sorted(cells.precision.unique()))}"),
        ("cells", f"{len(cells)} in {blocks} blocks, {contended_cells(race.analysis)} of them contended"),
    ]
    return _table(("what", "value"), rows)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}", *(f"| {' | '.join(row)} |" for row in rows)]
    return "\n".join(lines)


# --- what docs/renderers.md claims -----------------------------------------------------------------------------------


def claims(race: Race) -> None:
    """Raises `AssertionError` with the sentence that the archive does not bear out."""
    first = {(scene, target): race.possible(scene, target) for scene in race.scenes for target in race.targets}
    nobody = [where for where, best in first.items() if not best]
    assert nobody == [("living_room", race.targets[-1])], (
        f"somebody reached every error but the smallest of living_room: {nobody}"
    )
    for where, best in first.items():
        assert not best or {"numba", "numba-random"} & {*best}, f"numba is among the fastest everywhere: {where}: {best}"
    for target in race.targets:
        best = race.possible("gears", target)
        assert {"numba", "mitsuba"} <= {*best}, f"gears: numba and Mitsuba are not separated to {target}: {best}"
    hardest = race.targets[-1]
    mesh = {key: race.at("cornell_mesh", hardest, key).seconds for key in CONTESTANTS}
    assert min(mesh, key=mesh.__getitem__) == "mitsuba", f"Mitsuba has the shortest time on cornell_mesh: {mesh}"
    assert not race.ranked("cornell_mesh", "mitsuba"), "Mitsuba is not ranked on cornell_mesh"
    for scene, peer in (("cornell_box", "mitsuba"), ("gears", "mitsuba")):
        ours, other = race.at(scene, hardest, "embree"), race.at(scene, hardest, peer)
        assert ours.seconds_low > other.seconds_high, f"embree is slower than {peer} on {scene}: {ours}, {other}"
        assert race.ranked(scene, "embree") and race.ranked(scene, peer), f"both are ranked on {scene}"
    ranked = {key: [scene for scene in race.scenes if race.ranked(scene, key)] for key in ("luxcore", "cycles")}
    assert ranked == {"luxcore": ["gears"], "cycles": ["cornell_box", "study"]}, f"where they are ranked: {ranked}"
    for key, scenes in ranked.items():
        for scene in scenes:
            ratio = race.at(scene, hardest, key).seconds_low / race.at(scene, hardest, "numba").seconds_high
            assert 4 < ratio < inf, f"LuxCore and Cycles take more than four times as long: {scene}, {key}: {ratio}"
    for scene in ("cornell_mesh", "veach_plates", "living_room"):
        peers = [key for key in ("mitsuba", "mitsuba-random", "luxcore", "cycles") if race.ranked(scene, key)]
        assert not peers, f"only raybench's engines are ranked on {scene}: {peers}"
    study = {key: race.ranked("study", key) for key in ("mitsuba", "mitsuba-random", "luxcore", "cycles")}
    assert [key for key, ranked in study.items() if ranked] == ["cycles"], f"of the peers Cycles is ranked on study: {study}"
    for key in ("mitsuba", "mitsuba-random", "luxcore"):
        verdict = race.of["study", race.at("study", hardest, key).contestant]
        same = verdict.equivalence and verdict.equivalence.verdict
        assert same == "equivalent", f"{key} is equivalent to numba within the margins on study: {same}"
        assert verdict.bias and verdict.bias.difference > 0, f"{key} is brighter than the reference on study: {verdict.bias}"
    slow = race.at("veach_plates", race.targets[0], "cycles").seconds
    assert slow == inf, f"Cycles does not reach the largest error on veach_plates: {slow}"


# --- pages -----------------------------------------------------------------------------------------------------------

Makers = Mapping[str, Callable[[Sequence[str]], str]]


def makers() -> Makers:
    """Reads the archive."""
    race = Race(ROOT / "results" / "renderers")
    claims(race)
    return {"renderers": lambda words: renderers(race, words)}


def filled(text: str, made: Makers) -> str:
    """A page with its figures."""

    def fill(mark: re.Match[str]) -> str:
        name, *words = mark[2].split()
        space = "\n\n" if mark[3] else ""
        return f"{mark[1]}{space}{made[name](words)}{space}{mark[4]}"

    return MARK.sub(fill, text)


def prose(text: str) -> str:
    """A page without its figures."""
    return MARK.sub("", text)


def pages() -> list[Path]:
    """Those that have marks."""
    every = [ROOT / "README.md", *sorted((ROOT / "docs").glob("[!_]*/**/*.md")), *sorted((ROOT / "docs").glob("*.md"))]
    return [page for page in every if MARK.search(page.read_text(encoding="utf-8"))]


def main() -> None:
    made = makers()
    for page in pages():
        page.write_text(filled(page.read_text(encoding="utf-8"), made), encoding="utf-8")
        print(page.relative_to(ROOT))


if __name__ == "__main__":
    main()
