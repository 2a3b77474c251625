"""Choose the tests of the gate, and leave the others to the slow set: the names in tests/left_over.txt.

make gate-choice                       goes on where it was ended; to begin anew, remove out/random_mutants
make gate-choice MATRIX='--count 0'    the choice only, by what there is

First tests/mutants/random_sample.py makes the map of lines, with the CPU time of each test, and the kill matrix: which
two tests, or which one alone, kill each of 400 random mutants. Who kills a listed mutant `make mutants` has said.

Every line that the fast tests run, and every mutant that they kill, listed or random, keeps a test. These stay: the
contract suites, what costs next to nothing, what the map does not know (pages in a browser, child processes, public
data), and what is to kill a listed mutant that has not been run. Of the others those that add most per CPU second,
until nothing is missing. The rest goes, the most expensive first, until the gate is short enough. A test is a function
with all its parameters.
"""

from __future__ import annotations

import ast
import heapq
import json
import math
import sys
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache

from mutants import random_sample
from mutants.line_map import MAP, LineMap, function_of
from mutants.mutant import HERE, ROOT, all_mutants, is_there
from mutants.random_sample import LEFT_OVER, results_of

SEED = 20261204
MOST_S, CHEAP_S = 360.0, 0.02
"""CPU seconds with coverage: of the tests in the map, when the gate takes less than 400; of a test not worth moving."""


@dataclass(frozen=True)
class Costs:
    """CPU seconds of each test without its fixtures, and those of each fixture with the tests that take it."""

    own: Mapping[str, float]
    fixtures: Collection[tuple[float, Collection[str]]]

    def saved(self, moved: Collection[str]) -> dict[str, float]:
        """Return what the gate saves by each of these: a fixture only where all go that take it, each its share."""
        saved = {test: self.own[test] for test in moved}
        for seconds, takers in self.fixtures:
            if saved.keys() >= set(takers):
                saved |= {test: saved[test] + seconds / len(takers) for test in takers}
        return saved


def main() -> None:
    """Go on with the matrix, choose, and write the names."""
    random_sample.main(["--seed", str(SEED), "--count", "400", "--kills", "2", *sys.argv[1:]])
    known, killers = LineMap(), killing()
    covered, costs = covered_lines(known), measured(known)
    price = costs.saved(costs.own)
    stays = tuple(test for mutant in all_mutants() if mutant.id not in killers for test in mutant.tests)
    unknown = {function_of(test) for test in [*known.not_passed, *known.taking(known.children)]}
    dear = {test for test in covered if price.get(test, 0.0) >= CHEAP_S and test not in unknown}
    movable = {test for test in dear if not test.startswith(("tests/contract/", *stays))}
    for mutant, tests in killers.items():
        for test in tests:
            covered[test].add(mutant)
    left = movable - needed(covered, price, covered.keys() - movable)
    moved = most_expensive(costs, left, sum(price.values()) - MOST_S)
    LEFT_OVER.write_text("".join(f"{test}\n" for test in sorted(moved)), encoding="utf-8")
    every, kept = (set().union(*(covered[test] for test in tests)) for tests in (covered, covered.keys() - moved))
    print(
        f"CPU: {sum(price.values()):.0f} s, {sum(costs.saved(moved).values()):.0f} s of them moved",
        f"tests: {len(left)} that the gate does not need, {len(moved)} of them moved",
        f"lines: {len(every - killers.keys())}, {len(kept - killers.keys())} of them kept",
        f"mutants: {len(killers)}, {len(kept & killers.keys())} of them kept, "
        f"{sum(len(tests) == 1 for tests in killers.values())} by one test that is known",
        sep="\n",
    )


def measured(known: LineMap) -> Costs:
    """Return the CPU seconds of tests, without parameters, and of fixtures."""
    seconds: Counter[str] = Counter()
    for context, spent in known.cpu.items():
        seconds[function_of(context)] += spent
    takers = {name: {function_of(test) for test in tests} for name, tests in known.takers.items() if name in seconds}
    own = {test: spent for test, spent in seconds.items() if test and test not in takers}
    return Costs(own, [(seconds[name], tests) for name, tests in takers.items()])


def covered_lines(known: LineMap) -> dict[str, set[object]]:
    """Return the lines that each test runs, without those of a module itself, which whoever imports it first runs."""
    found: dict[str, set[object]] = defaultdict(set)
    for file, line, test in known.lines():
        if file.endswith(".py") and line in _in_functions(file):  # templates count as sources, too
            found[function_of(test)].add((file, line))
    return found


@cache
def _in_functions(file: str) -> frozenset[int]:
    every = ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8")))
    functions = [node for node in every if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return frozenset(line for node in functions for line in range(node.body[0].lineno, (node.end_lineno or 0) + 1))


def killing() -> dict[str, set[str]]:
    """Return the tests that are known to kill each mutant, but for those with which nothing can be imported."""
    listed = json.loads((HERE / "results.json").read_text(encoding="utf-8"))
    drawn = results_of(MAP.with_name(f"{SEED}.jsonl"))
    found = {id_: {test} for id_, test in listed.items() if is_there(ROOT, test)} | {
        id_: set(said["killers"]) for id_, said in drawn.items()
    }
    return {id_: tests for id_, tests in found.items() if tests and all("::" in test for test in tests)}


def needed(covered: Mapping[str, set[object]], price: Mapping[str, float], kept: Collection[str]) -> set[str]:
    """Return the tests that cover what those kept do not, the most per CPU second first."""
    missing = set().union(*covered.values()) - set().union(*(covered[test] for test in kept))
    waiting = [(-math.inf, test) for test in sorted(covered.keys() - set(kept))]
    found = set()
    while missing:
        _, test = heapq.heappop(waiting)
        rank = (-len(covered[test] & missing) / price[test], test)
        if waiting and rank > waiting[0]:
            heapq.heappush(waiting, rank)
        else:
            found.add(test)
            missing -= covered[test]
    return found


def most_expensive(costs: Costs, left: Collection[str], to_save_s: float) -> set[str]:
    """Return so many of the tests left over, the most expensive first, that the gate saves this time, or all."""
    price = costs.saved(left)
    moved: set[str] = set()
    for test in sorted(left, key=lambda test: (-price[test], test)):
        if sum(costs.saved(moved).values()) >= to_save_s:
            break
        moved.add(test)
    return moved


if __name__ == "__main__":
    main()
